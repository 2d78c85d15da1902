"""Table 1 of liu2007: clocks of every size, cells of the small ones."""

import pytest

from kalmanhdl.reproduce import liu2007_areas
from kalmanhdl.reproduce.liu2007_areas import Sized, reproduction, sizes
from kalmanhdl.toolchain.area import AreaFigures


def test_a_larger_filter_takes_more_clocks_and_blocks_fewer_than_logic(monkeypatch):
    monkeypatch.setattr(liu2007_areas, "SYNTHESISED", ())
    (small, in_logic), (large, _) = (tuple(sizes("Bierman-Thornton", n, 12)) for n in (3, 4))
    assert small.interval < large.interval
    assert small.interval < in_logic.interval
    assert (small.blocks, in_logic.blocks, small.cells) == (True, False, None)


def test_a_row_counts_the_slices_that_its_cells_fill_beside_the_papers():
    cells = AreaFigures(
        family="xc4v",
        family_name="Virtex-4",
        tool="yosys",
        luts=1001,
        carry=0,
        ffs=900,
        multipliers=24,
        block_rams=1,
        cells={},
    )
    sized = Sized(
        name="Taylor about I",
        states=3,
        width=12,
        blocks=True,
        interval=40,
        period_ns=5.0,
        cells=cells,
    )
    (row,) = reproduction((sized,)).rows
    assert row[4:] == ("40", "0.200", "24", "1", "1001", "900", "501", "24", "3848")


@pytest.mark.slow
def test_a_small_filter_is_synthesised_with_no_more_than_a_block_for_each_multiplier():
    found = next(sizes("Bierman-Thornton", 3, 12))
    assert found.cells is not None
    assert 0 < found.cells.multipliers <= 24
