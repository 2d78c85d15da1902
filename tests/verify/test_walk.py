"""Walks of commands into corners of the state space."""

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import numbers_of
from kalmanhdl.simulate.commands import Command
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.verify.stimulus import walking
from kalmanhdl.verify.walk import walks

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def typed():
    model = linear_model(
        [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    return numbers_of(Design(name="axis", model=model, numerics=FixedSpecification(width=12))).typed


def test_walks_reach_the_ends_of_the_covariance_and_let_values_leave_their_formats(typed):
    found = walks(typed, 1)
    steps = walking(typed, found, 3, 1, calm=True)
    trace = Engine.of(typed, optimised=False).run(
        steps.inputs, steps.flags, active=steps.active, monitor=True
    )
    highest = {name: trace.extremes[root].high for name, root in typed.graph.states if root in trace.extremes}
    form = {name: typed.formats[root] for name, root in typed.graph.states}
    assert highest["P[0,0]"] == form["P[0,0]"].highest
    assert sum(trace.violations.values())
    assert highest["x[0]"] == 0, "calm data leave the estimate alone"


def test_every_step_of_every_walk_is_sent_in_its_order(typed):
    found = walks(typed, 1)
    steps = walking(typed, found, 2, 5)
    assert len(steps.order) == sum(map(len, found)) == steps.active.sum()
    first = steps.commands[: len(found[0]), 0]
    assert ((first == Command.INITIALISE) == found[0].flags["initialise"]).all()
    assert (steps.offered["valid[0]"][: len(found[0]), 0] == found[0].flags["valid[0]"]).all()


def test_the_same_seed_gives_the_same_walks(typed):
    for one, other in zip(walks(typed, 7), walks(typed, 7), strict=True):
        assert one.flags.keys() == other.flags.keys()
        assert all(np.array_equal(one.flags[name], other.flags[name]) for name in one.flags)
