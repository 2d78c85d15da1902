"""The specification that chosen widths make."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.design_file.writer import dumps
from kalmanhdl.explore.choice import specification_of, variables_of
from kalmanhdl.explore.program import Code, Program, operand_steps, program_of
from kalmanhdl.numerics.integers import in_reals
from kalmanhdl.numerics.specification import FixedSpecification

DESIGNS = Path(__file__).parents[2] / "designs"


def _program(design: Design) -> Program:
    reals = in_reals(design.model, design.algorithm, design.fixed_point)
    return program_of(reals.graph, reals.ranges)


@pytest.mark.parametrize("path", sorted(DESIGNS.glob("*.toml")), ids=lambda path: path.stem)
def test_widths_chosen_for_a_design_are_a_design_file(path, tmp_path):
    """Whatever signals a filter has: their names are those that a design file may give."""
    design = Design.load(path)
    if not isinstance(design.numerics, FixedSpecification):
        pytest.skip("computes in floating point")
    program = _program(design)
    variables = variables_of(program, {})
    widths = np.arange(len(variables)) % 7 + 40
    chosen = specification_of(design.numerics, variables, widths)
    written = tmp_path / "chosen.toml"
    written.write_text(dumps(replace(design, numerics=chosen)))
    assert Design.load(written).numerics == chosen


@pytest.mark.parametrize("name", ["dcmkf_radar", "ekf_radar", "imm_radar", "lee1997"])
def test_every_format_that_an_estimate_rests_on_is_chosen(name):
    """Estimates of several modes are put together from what is no state: those formats count as well."""
    program = _program(Design.load(DESIGNS / f"{name}.toml"))
    chosen = {k for variable in variables_of(program, {}) for k in variable.slots}
    seen, left = set(), [root for output, root in program.outputs if output.startswith("x[")]
    while left:
        index = left.pop()
        if index not in seen:
            seen.add(index)
            left.extend(operand_steps(program.steps[index]))
    quantised = {program.steps[k].slot for k in seen if program.steps[k].code is Code.QUANTISE}
    assert quantised
    assert {k for k in quantised if program.slots[k].signal_class != "bit"} <= chosen
