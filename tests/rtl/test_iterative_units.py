"""Iterative operators in a filter: the Verilog is the engine's, bit for bit."""

import numpy as np
import pytest

from kalmanhdl.arithmetic.division import LongDivision
from kalmanhdl.design import Architecture, Design
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import compile_design, verify


@pytest.mark.parametrize(
    ("radix", "iterative", "channels"),
    [(2, ("reciprocal",), 1), (4, ("multiply", "reciprocal"), 3)],
)
def test_iterative_operators_are_bit_exact(radix: int, iterative: tuple[str, ...], channels: int):
    F = np.array([[0.85, 0.27], [-0.27, 0.85]])
    model = linear_model(
        F, np.eye(2), 0.2 * np.eye(2), 1.2 * np.eye(2), initial=given([0.5, -0.25], np.eye(2))
    )
    design = Design(
        name="iterative",
        model=model,
        numerics=FixedSpecification(width=12, division=LongDivision(radix=radix)),
        architecture=Architecture(
            units={"multiply": 2, "reciprocal": 1},
            iterative=iterative,
            channels=channels,
            solver_seconds=0,
        ),
    )
    hardware = compile_design(design)
    assert {unit.kind for unit in hardware.plan.units if unit.busy > 1} == set(iterative)
    assert all(found.mismatches == 0 for found in verify(hardware, 400, optimised=False))
