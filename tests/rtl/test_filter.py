"""The whole filter in hardware against the exact interpreter, through its streams."""

from random import Random

import pytest
from devices import PLAUSIBLE
from graphs import alpha_beta, typed_graphs
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from steps import expected, observable, random_steps, run, well_formed

from kalmanhdl.errors import ScheduleError
from kalmanhdl.graph.kinds import KINDS
from planning import planned


@pytest.mark.parametrize(("interval", "channels"), [(1, 1), (None, 1), (1, 16), (1, 5), (3, 4), (1, 2)])
def test_every_result_is_that_of_the_interpreter_under_stalls(interval, channels):
    plan = planned(observable(alpha_beta()), PLAUSIBLE, interval, channels)
    random = Random(channels)
    steps = random_steps(plan, 150, random)
    outcome = run(plan, steps, random, gaps=0.3, holds=0.3)
    assert outcome.results == expected(plan, steps)[0]


few = st.dictionaries(st.sampled_from(KINDS), st.integers(1, 2))

any_run = given(
    typed_graphs(),
    st.sampled_from([None, 1, 2, 3, 5]),
    st.integers(1, 5),
    st.randoms(use_true_random=False),
    st.sampled_from([0.0, 0.5]),
    st.sampled_from([0.0, 0.5]),
    st.one_of(st.just({}), st.none(), few),
)


def runs_as_the_interpreter_says(typed, interval, channels, random, gaps, holds, units):
    assume(well_formed(typed))
    if units:
        # An interval that suits the operators is found.
        interval = None
    try:
        plan = planned(observable(typed), PLAUSIBLE, interval, channels, units=units)
    except ScheduleError as error:
        assume("cannot share" not in str(error))
        raise
    steps = random_steps(plan, 30, random)
    assert run(plan, steps, random, gaps, holds).results == expected(plan, steps)[0]


@settings(max_examples=10, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@any_run
def test_any_graph_runs_as_the_interpreter_says(typed, interval, channels, random, gaps, holds, units):
    runs_as_the_interpreter_says(typed, interval, channels, random, gaps, holds, units)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@any_run
def test_many_graphs_run_as_the_interpreter_says(typed, interval, channels, random, gaps, holds, units):
    runs_as_the_interpreter_says(typed, interval, channels, random, gaps, holds, units)


@pytest.mark.parametrize(("interval", "channels"), [(1, 1), (1, 16), (2, 8), (5, 2), (None, 1)])
def test_taking_turns_runs_at_full_rate(interval, channels):
    plan = planned(alpha_beta(), PLAUSIBLE, interval, channels)
    steps = random_steps(plan, 120, Random(0), tracks=list(range(channels)))
    outcome = run(plan, steps, Random(0))
    assert len(outcome.results) == 120
    clocks = [b - a for a, b in zip(outcome.given_at[20:], outcome.given_at[21:], strict=False)]
    assert set(clocks) == {plan.interval}


def test_one_track_at_a_time_waits_out_the_distance():
    plan = planned(observable(alpha_beta()), PLAUSIBLE, 1, 16)
    steps = random_steps(plan, 60, Random(1), tracks=[3])
    outcome = run(plan, steps, Random(1))
    assert outcome.results == expected(plan, steps)[0]
    clocks = [b - a for a, b in zip(outcome.given_at, outcome.given_at[1:], strict=False)]
    assert set(clocks) == {plan.distance}
