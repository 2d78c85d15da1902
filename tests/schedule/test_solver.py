"""What the solver adds to the list schedule: never worse, always the same, and right about the least."""

import re
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from signal import SIGINT

import pytest
from devices import PLAUSIBLE, UNIT
from graphs import WORD, Builder, alpha_beta, typed_graphs
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kalmanhdl.arithmetic.fixed import Overflow, Rounding
from kalmanhdl.errors import ScheduleError
from kalmanhdl.graph.operations import Add, State
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.placement import pace, step_of
from kalmanhdl.schedule.precedence import precedence
from kalmanhdl.schedule.sharing import sharing
from kalmanhdl.schedule.solver import Effort, Problem, solve
from kalmanhdl.schedule.turns import at_cycles
from kalmanhdl.schedule.wanted import Wanted


def waves(length: int) -> TypedGraph:
    """A state of ``length`` products in a row, beside as many that hurry to one of their own."""
    b = Builder()
    states = [b.source(State(name), WORD) for name in ("x", "y")]
    roots = []
    for k, state in enumerate(states):
        value = state
        for i in range(length):
            factor = b.constant(77 + 2 * i + 40 * k, 7)
            value = b.quantise(b.multiply(value, factor), WORD, Rounding.FLOOR, Overflow.SATURATE)
            value = b.quantise(b.sum(Add, value, states[1 - k]), WORD, Rounding.FLOOR, Overflow.SATURATE)
        roots.append(value)
    return b.typed({"x": roots[0], "y": roots[1]}, {"x": roots[0]}, Rounding.FLOOR)


@settings(max_examples=40, deadline=None)
@given(
    typed_graphs(),
    st.sampled_from((1, 3)),
    st.dictionaries(st.sampled_from(("add", "multiply", "divide")), st.integers(1, 3), min_size=1),
)
def test_a_solved_schedule_is_right_and_never_worse_than_the_list(
    typed: TypedGraph, channels: int, units: dict[str, int]
):
    wanted = Wanted(channels=channels, units=units, solver_seconds=0.2)
    try:
        listed = schedule(typed, PLAUSIBLE, replace(wanted, solver_seconds=0))
    except ScheduleError as error:
        assume("cannot share" not in str(error))
        raise
    solved = schedule(typed, PLAUSIBLE, wanted)
    assert problems(solved, PLAUSIBLE) == problems(listed, PLAUSIBLE) == []
    assert solved.interval <= listed.interval
    assert solved.interval < listed.interval or solved.latency <= listed.latency
    assert listed.least_interval <= solved.least_interval <= solved.interval
    assert solved.least_latency <= solved.latency


def test_equal_tasks_give_equal_schedules():
    wanted = Wanted(units={"multiply": 1, "add": 1}, channels=3, solver_seconds=0.5)
    assert schedule(waves(3), PLAUSIBLE, wanted) == schedule(waves(3), PLAUSIBLE, wanted)


def test_a_schedule_said_to_be_the_least_is_the_least_of_all():
    typed = alpha_beta()
    shared = sharing(typed, {"multiply": 1})
    at = pace(step_of(typed, UNIT, 1, frozenset(), shared), 3000)
    points = precedence(at, shared)
    interval = 40
    problem = Problem(
        points=points, sharing=shared, registers=at.registers, interval=interval, longest=interval, latency=60
    )
    hint = dict.fromkeys((*points.shared, *(loop.read for loop in points.loops)), 0)
    answer = solve(problem, Effort(5.0), 1.0, hint)
    assert answer.cycles is not None

    def latency(cycles: dict[int, int]) -> int:
        turns = at_cycles(at, shared, cycles)
        return 1 + max(turns.times[root] >> 40 for root in typed.graph.roots)

    reads = {loop.read: 0 for loop in points.loops}
    tried = []
    for starts in product(range(20), repeat=len(points.shared)):
        cycles = dict(zip(points.shared, starts, strict=True)) | reads
        waits = all(
            cycles[k] >= cycles.get(p, 0) + after for k, ps in points.after.items() for p, after in ps.items()
        )
        if waits and len({start % interval for start in starts}) == len(starts):
            tried.append(latency(cycles))
    assert latency(dict(answer.cycles)) == answer.latency == min(tried)


def test_an_interval_that_cannot_be_is_proven_so():
    typed = waves(2)
    shared = sharing(typed, {"multiply": 1, "add": 1})
    at = pace(step_of(typed, PLAUSIBLE, 1, frozenset(), shared), 6000)
    problem = Problem(
        points=precedence(at, shared),
        sharing=shared,
        registers=at.registers,
        interval=4,
        longest=4,
        latency=1,
    )
    assert solve(replace(problem, latency=problem.unlimited), Effort(1.0), 1.0).impossible


@pytest.mark.parametrize(
    ("length", "adders", "listed", "solved"), [(3, 1, (6, 15), (6, 13)), (5, 2, (7, 16), (6, 18))]
)
def test_the_solver_finds_the_least_interval_and_then_the_least_latency(
    length: int, adders: int, listed: tuple[int, int], solved: tuple[int, int]
):
    wanted = Wanted(units={"multiply": 1, "add": adders}, channels=3)
    before = schedule(waves(length), PLAUSIBLE, replace(wanted, solver_seconds=0))
    after = schedule(waves(length), PLAUSIBLE, wanted)
    assert (before.interval, before.latency) == listed
    assert (after.interval, after.latency) == (after.least_interval, after.least_latency) == solved


def test_fewer_operators_meet_an_interval():
    def multipliers(seconds: float, interval: int) -> int:
        plan = schedule(waves(4), PLAUSIBLE, Wanted(interval=interval, solver_seconds=seconds))
        assert problems(plan, PLAUSIBLE) == []
        return plan.sharing.counts.get("multiply", 8)

    loop = schedule(waves(4), PLAUSIBLE, Wanted(units={})).interval
    assert all(multipliers(1.0, loop + k) <= multipliers(0, loop + k) for k in range(4))


@pytest.mark.parametrize("seconds", [-1, "much", True])
def test_an_effort_that_cannot_be_is_refused(seconds: object):
    from kalmanhdl.design import Architecture
    from kalmanhdl.errors import DesignError

    with pytest.raises(DesignError, match="solver_seconds"):
        Architecture(solver_seconds=seconds)  # type: ignore[arg-type]


def caught(number: int) -> bool:
    """Whether the process has a handler of its own for a signal, as the system knows it."""
    status = Path("/proc/self/status").read_text()
    return bool(int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16) >> (number - 1) & 1)


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_search_leaves_ctrl_c_to_the_command():
    assert caught(SIGINT)
    schedule(waves(3), PLAUSIBLE, Wanted(units={"multiply": 1, "add": 1}, channels=3, solver_seconds=0.1))
    assert caught(SIGINT)
