"""Table 1 of liu2007: its filters of three to six states, as many measurements, with and without DSP blocks.

Clocks are those of the schedule of every size. On Virtex-4, the paper's device, the smaller ones are
synthesised as well, in the table's 12 bits: Yosys knows no place and route for it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from kalmanhdl.design import Design
from kalmanhdl.pipeline import Progress, numbers_of, planned, silent, verilog_of
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.liu2007_hardware import ALGORITHMS, shared_design
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.toolchain.area import AreaFigures, area

SIZES = (3, 4, 5, 6)
WIDTHS = (12, 16)
SYNTHESISED = (3, 4)
"""Sizes whose synthesis takes minutes."""
_FAMILY = "xc4v"
_BITS_OF_TABLE = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sized:
    """A filter of ``states`` states and measurements, and, if synthesised, its cells."""

    name: str
    states: int
    width: int
    blocks: bool
    interval: int
    period_ns: float
    cells: AreaFigures | None


def figures(progress: Progress = silent) -> tuple[Sized, ...]:
    """Every size, width and filter, with multiplier blocks and without."""
    return tuple(
        sized
        for states, name, width in product(SIZES, ALGORITHMS, WIDTHS)
        for sized in sizes(name, states, width, progress)
    )


def sizes(name: str, states: int, width: int, progress: Progress = silent) -> Iterator[Sized]:
    """A filter of ``ALGORITHMS`` on multiplier blocks, then on multipliers of logic."""
    wide = shared_design(name, states=states, width=width)
    told = f"{states} states, {width} bits, {name}"
    progress(f"{told}: scheduling")
    typed = numbers_of(wide)
    for blocks in (None, 0):
        design = shared_design(name, states=states, width=width, blocks=blocks)
        plan = planned(design, typed)
        measured = states in SYNTHESISED and width == _BITS_OF_TABLE
        if measured:
            progress(
                f"{told}, {'with' if blocks is None else 'without'} DSP blocks: synthesising for {_FAMILY}"
            )
        yield Sized(
            name=name,
            states=states,
            width=width,
            blocks=blocks is None,
            interval=plan.interval,
            period_ns=plan.period_ns,
            cells=_cells(design, plan) if measured else None,
        )


def _cells(design: Design, plan: Plan) -> AreaFigures:
    return area(verilog_of(design, plan), design.name, _FAMILY)


def reproduction(found: tuple[Sized, ...]) -> Reproduction:
    """Ours beside the paper's slices and blocks."""
    printed = facts("liu2007")["areas"]
    return Reproduction(
        title="Liu, Bouganis & Cheung 2007, table 1: one track, n = m",
        columns=(
            "filter",
            "n = m",
            "bits",
            "DSP blocks",
            "clocks a step",
            "estimate, us",
            "DSP48",
            "block RAMs",
            "LUTs",
            "registers",
            "slices, at least",
            "paper: DSP48",
            "paper: slices",
        ),
        rows=tuple(_row(sized, printed[sized.name]) for sized in found),
        notes=tuple(printed["notes"]),
        charts={},
    )


def _row(sized: Sized, printed: dict[str, dict[str, int]]) -> tuple[str, ...]:
    paper, cells = printed[str(sized.states)], sized.cells
    of_table = sized.width == _BITS_OF_TABLE
    theirs = (
        str(paper["dsp48"]) if of_table and sized.blocks else "",
        str(paper["slices" if sized.blocks else "slices_no_dsp"]) if of_table else "",
    )
    # A slice of Virtex-4 has two look-up tables and two registers.
    counts = () if cells is None else (cells.multipliers, cells.block_rams, cells.luts, cells.ffs)
    slices = () if cells is None else (-(-max(cells.luts, cells.ffs) // 2),)
    ours = tuple(map(str, (*counts, *slices))) or ("",) * 5
    return (
        sized.name,
        str(sized.states),
        str(sized.width),
        "yes" if sized.blocks else "no",
        str(sized.interval),
        f"{sized.interval * sized.period_ns / 1000:.3f}",
        *ours,
        *theirs,
    )
