"""What the steps are that verification sends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kalmanhdl.design import Design
from kalmanhdl.graph.operations import Input
from kalmanhdl.model.initial import given as given_state
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import numbers_of
from kalmanhdl.rtl.interface import interface
from kalmanhdl.simulate.commands import Command
from kalmanhdl.verify.stimulus import FOURTH, random_sections, random_steps
from verify.test_timing import plan_of


@pytest.fixture(scope="module")
def plan():
    return plan_of(channels=5, interval=1, distance=9)


@settings(deadline=None)
@given(count=st.integers(1, 400), channels=st.integers(1, 20), seed=st.integers(0, 1000))
def test_every_step_is_sent_once_and_the_steps_of_a_track_in_their_order(plan, count, channels, seed):
    steps = random_steps(plan.typed, count, channels, seed)
    assert len(steps.order) == len(set(steps.order.tolist())) == count == steps.active.sum()
    rows = steps.order // channels
    for track in range(channels):
        assert (np.diff(rows[steps.tracks == track]) == 1).all()


def test_random_steps_hold_every_command_every_flag_and_the_limits_of_every_number(plan):
    steps = random_steps(plan.typed, 5000, 5, 1)
    sent = steps.commands.ravel()[steps.order]
    assert set(sent.tolist()) == {Command.INITIALISE, Command.PREDICT, Command.UPDATE, FOURTH}
    raws = steps.inputs["z[0]"]
    form = next(form for form in plan.typed.formats if form is not None and form.width == 12 and form.signed)
    assert (raws.min(), raws.max()) == (form.lowest, form.highest)
    present = steps.offered["valid[0]"]
    assert present[steps.commands == FOURTH].any(), "a prediction is offered measurements"
    assert not steps.flags["valid[0]"][(steps.commands == FOURTH) | (steps.commands == Command.PREDICT)].any()


def test_random_steps_hold_tracks_in_turn_and_the_same_track_again_and_again(plan):
    tracks = random_steps(plan.typed, 5000, 5, 1).tracks
    same = np.diff(tracks) == 0
    assert np.convolve(same, np.ones(20), "valid").max() == 20
    assert np.convolve(~same, np.ones(20), "valid").max() == 20


@pytest.mark.parametrize("count", [1, 7, 100, 1000, 20_000])
def test_sections_take_exactly_the_steps_that_were_asked_for(plan, count):
    sections = random_sections(plan, interface(plan), count, 3)
    assert sum(len(section.steps.order) for section in sections) == count
    assert all(len(section.steps.order) >= section.left for section in sections)
    assert not sections[-1].left


def test_sections_pause_fill_the_hardware_and_leave_results_on_the_way(plan):
    sections = random_sections(plan, interface(plan), 20_000, 3)
    assert any(section.calm for section in sections)
    assert any(section.blocked for section in sections)
    assert any(section.stalls.sink for section in sections)
    assert {section.left for section in sections} >= {0, 1, 2, 3}


@pytest.mark.parametrize(
    "numerics",
    [
        *(FixedSpecification(width=width) for width in (63, 64, 65)),
        FloatSpecification(exponent=11, mantissa=52),
    ],
    ids=["63 bits", "64 bits", "65 bits", "double"],
)
def test_random_numbers_as_wide_as_a_word_have_every_bit(numerics):
    model = linear_model([[1.0]], [[1.0]], [[1.0]], [[1.0]], initial=given_state([0.0], [[1.0]]))
    typed = numbers_of(Design(name="one", model=model, numerics=numerics)).typed
    steps = random_steps(typed, 200, 1, 1)
    formats = zip(typed.graph.operations, typed.formats, strict=True)
    for name, form in [(o.name, form) for o, form in formats if isinstance(o, Input)]:
        raws = steps.inputs[name].ravel()
        assert all(isinstance(raw, int | np.integer) for raw in raws)
        seen = [int(raw) % (1 << form.width) for raw in raws]
        assert np.bitwise_or.reduce(np.array(seen, object)) == (1 << form.width) - 1
        assert np.bitwise_and.reduce(np.array(seen, object)) == 0
