"""Bounds that hold for ever, against the engine."""

import numpy as np
import pytest

from invariant import assumed, bounds
from kalmanhdl.design import Design
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import numbers_of
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.verify.stimulus import random_steps
from random_designs import random_design

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def axis():
    model = linear_model(
        [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    return numbers_of(Design(name="axis", model=model, numerics=FixedSpecification(width=12))).typed


def test_the_covariance_of_position_and_velocity_is_never_negative(axis):
    found = {name: bounds(axis)[root] for name, root in axis.graph.states if name != "saturated"}
    assert found["P[0,1]"].low == 0
    assert found["x[0]"].low < 0


@pytest.mark.parametrize("seed", [1, 3, 12])
def test_no_value_of_random_steps_leaves_its_bounds(seed):
    typed = numbers_of(random_design(seed, 3, 2)).typed
    steps = random_steps(typed, 4000, 8, seed)
    trace = Engine.of(typed, optimised=False).run(
        steps.inputs, steps.flags, active=steps.active, monitor=True
    )
    held = bounds(typed)
    assert trace.extremes
    for index, seen in trace.extremes.items():
        assert held[index].low <= seen.low <= seen.high <= held[index].high, typed.graph.origins[index]


def test_only_bits_that_are_always_zero_are_read_as_zero(axis):
    index = dict(axis.graph.states)["P[0,1]"]
    width = axis.formats[index].width
    verilog = (
        f"module top.datapath (clk);\n  reg [{width - 1}:0] posterior_P_0_1_c9 = {width}'h0;\n"
        f"  reg [{width - 1}:0] posterior_x_0_c9;\n"
        "  assign a = posterior_P_0_1_c9[11] ? posterior_x_0_c9 : posterior_P_0_1_c91;\nendmodule\n"
    )
    known, wires = assumed(verilog, axis)
    assert wires == {"datapath.posterior_P_0_1_c9_known"}
    assert f"posterior_P_0_1_c9_known = {{ 1'h0, posterior_P_0_1_c9[{width - 2}:0] }};" in known
    assert "= posterior_P_0_1_c9_known[11] ? posterior_x_0_c9 : posterior_P_0_1_c91;" in known
