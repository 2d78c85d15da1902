"""When results come, on schedules of pinned interval and distance; test_compare.py has the Verilog."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.build import planned_design
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.verify.timing import accepted_again, handed_over, held_back, never_waits


def plan_of(channels: int, interval: int, distance: int):
    model = linear_model(
        [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    design = Design(
        name="axis",
        model=model,
        numerics=FixedSpecification(width=12),
        architecture=Architecture(interval=1, channels=3),
        target=Target(device="unit", grade=1),
    )
    _, plan = planned_design(design)
    return replace(plan, channels=channels, interval=interval, distance=distance)


@pytest.fixture(scope="module")
def plan():
    return plan_of(channels=3, interval=2, distance=5)


def test_results_come_in_every_interval_unless_a_track_comes_again_too_early(plan):
    clocks = handed_over(plan, np.array([0, 1, 2, 0, 0]))
    # A distance of five clocks is three intervals of two.
    assert np.diff(clocks).tolist() == [2, 2, 2, 6]


@given(tracks=st.lists(st.integers(0, 2), min_size=1, max_size=50))
def test_results_keep_order_interval_and_distance(plan, tracks):
    clocks = handed_over(plan, np.array(tracks))
    assert (np.diff(clocks) >= plan.interval).all()
    for track in set(tracks):
        assert (np.diff(clocks[np.array(tracks) == track]) >= plan.distance).all()


@pytest.mark.parametrize(("channels", "never"), [(2, False), (3, True)])
def test_tracks_in_turn_wait_where_they_are_fewer_than_the_distance(plan, channels, never):
    assert never_waits(replace(plan, channels=channels)) is never


def test_full_hardware_holds_the_queue_and_what_waits_for_it(plan):
    waiting_for_tracks = 2
    one_track = replace(plan, channels=1, distance=2)
    assert held_back(plan) - held_back(one_track) == waiting_for_tracks


def test_a_place_that_is_free_again_lets_a_step_in_at_the_next_interval(plan):
    assert {accepted_again(plan, clock) - clock for clock in (10, 12, 14)} == {3}
    assert {accepted_again(plan, clock) - clock for clock in (11, 13, 15)} == {4}
