"""The specification that chosen widths make."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.design_file.writer import dumps
from kalmanhdl.explore.choice import specification_of, variables_of
from kalmanhdl.explore.program import program_of
from kalmanhdl.numerics.integers import in_reals
from kalmanhdl.numerics.specification import FixedSpecification

DESIGNS = Path(__file__).parents[2] / "designs"


@pytest.mark.parametrize("path", sorted(DESIGNS.glob("*.toml")), ids=lambda path: path.stem)
def test_widths_chosen_for_a_design_are_a_design_file(path, tmp_path):
    """Whatever signals a filter has: their names are those that a design file may give."""
    design = Design.load(path)
    if not isinstance(design.numerics, FixedSpecification):
        pytest.skip("computes in floating point")
    reals = in_reals(design.model, design.algorithm, design.numerics)
    variables = variables_of(program_of(reals.graph, reals.ranges), {})
    widths = np.arange(len(variables)) % 7 + 40
    chosen = specification_of(design.numerics, variables, widths)
    written = tmp_path / "chosen.toml"
    written.write_text(dumps(replace(design, numerics=chosen)))
    assert Design.load(written).numerics == chosen
