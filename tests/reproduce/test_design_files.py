"""The design files of papers are the designs that their tables of hardware build."""

from pathlib import Path

import pytest

from kalmanhdl.design import Design
from kalmanhdl.reproduce import liu2007_hardware, wu2012_hardware
from test_design_file import assert_same

DESIGNS = Path(__file__).parents[2] / "designs"
TAYLOR, _, BIERMAN_THORNTON, _ = liu2007_hardware.candidates()
BUILT = {
    "liu2007_taylor": TAYLOR,
    "liu2007_bierman_thornton": BIERMAN_THORNTON,
    "wu2012_single": wu2012_hardware.candidates()[-1],
}


@pytest.mark.parametrize("name", BUILT)
def test_a_design_file_is_the_design_of_the_table(name):
    written, built = Design.load(DESIGNS / f"{name}.toml"), BUILT[name].design
    assert_same(written.model, built.model)
    assert (written.algorithm, written.numerics) == (built.algorithm, built.numerics)
    assert written.architecture == built.architecture
    assert (written.target.device, written.target.grade) == (built.target.device, built.target.grade)
