"""Better schedules than a list gives, by constraint programming (OR-Tools CP-SAT), within a limit of effort.

Effort is counted in the solver's own seconds, which do not depend on the machine, and one worker with a fixed
seed searches: equal tasks give equal schedules.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kalmanhdl.schedule.precedence import ISSUE, Precedence
from kalmanhdl.schedule.sharing import Sharing

if TYPE_CHECKING:
    from ortools.sat.python.cp_model import CpModel, IntervalVar, IntVar, LinearExprT

MOST_SHARED = 400
"""With more operations on shared operators the solver finds nothing in reasonable time."""


@dataclass(slots=True)
class Effort:
    """The solver's seconds that are left."""

    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Operations on shared operators, in steps ``interval`` cycles apart.

    Those of a track follow each other within ``longest`` cycles; the last result is there within ``latency``.
    """

    points: Precedence
    sharing: Sharing
    registers: Sequence[int]
    interval: int
    longest: int
    latency: int

    @property
    def unlimited(self) -> int:
        """A latency within which there is a schedule if there is one at all.

        Were a point an interval or more later than all that it waits for, it could be an interval earlier.
        """
        weights = [cycles for before in self.points.after.values() for cycles in before.values()]
        weights += [cycles for loop in self.points.loops for cycles in loop.sources.values()]
        points = len(self.points.shared) + len(self.points.loops) + 1
        return (max(weights, default=0) + self.interval) * points + max(self.points.ends.values(), default=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Cycles of the shared operations and of the states' reads, where some were found.

    No schedule has less than ``latency``, where the least was asked for. ``impossible``: there is none.
    """

    cycles: Mapping[int, int] | None
    latency: int = 1
    impossible: bool = False


def solve(problem: Problem, effort: Effort, part: float, hint: Mapping[int, int] | None = None) -> Answer:
    """Some schedule, or the one of the least latency where ``hint`` gives one to begin with.

    Not more than ``part`` of the effort that is left is spent.
    """
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    points = _points(model, problem)
    _wait(model, problem, points)
    _follow(model, problem, points)
    _take_turns(model, problem, points)
    last = model.new_int_var(1, problem.latency, "latency")
    for point, cycles in problem.points.ends.items():
        model.add(last >= points[point] + cycles + 1)
    if hint is not None:
        model.minimize(last)
        for point, variable in points.items():
            if point != ISSUE:
                model.add_hint(variable, hint[point])
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = 1
    # Ctrl-C would only end this search, and the process from then on without a word.
    solver.parameters.catch_sigint_signal = False
    solver.parameters.max_deterministic_time = effort.seconds * part
    status = solver.solve(model)
    effort.seconds = max(0.0, effort.seconds - solver.response_proto.deterministic_time)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return Answer(cycles=None, impossible=status == cp_model.INFEASIBLE)
    found = {point: solver.value(variable) for point, variable in points.items()}
    bound = 1 if hint is None else round(solver.best_objective_bound)
    return Answer(cycles=found, latency=bound)


Points = dict[int, "IntVar"]


def _points(model: "CpModel", problem: Problem) -> Points:
    reads = (loop.read for loop in problem.points.loops)
    found = {k: model.new_int_var(0, problem.latency, f"c{k}") for k in (*problem.points.shared, *reads)}
    return found | {ISSUE: model.new_constant(0)}


def _wait(model: "CpModel", problem: Problem, points: Points) -> None:
    for index, before in problem.points.after.items():
        for point, cycles in before.items():
            model.add(points[index] >= points[point] + cycles)


def _follow(model: "CpModel", problem: Problem, points: Points) -> None:
    """A state is read by the next step after it is stored, and by this step not later."""
    for loop in problem.points.loops:
        for point, cycles in loop.sources.items():
            model.add(points[loop.read] + problem.longest >= points[point] + cycles + loop.least)
        if loop.read not in loop.sources:
            stored = model.new_int_var(0, problem.latency, f"s{loop.read}")
            model.add_max_equality(stored, [points[p] + cycles for p, cycles in loop.sources.items()])
            model.add(points[loop.read] <= stored)


def _take_turns(model: "CpModel", problem: Problem, points: Points) -> None:
    for kind, who in problem.sharing.operations.items():
        taken = [
            _in_interval(model, problem, points[index], problem.sharing.cycles(kind, index), f"{index}")
            for index in who
        ]
        model.add_cumulative(taken, [1] * len(taken), problem.sharing.counts[kind])
    leaving = [
        _in_interval(model, problem, points[index] + problem.registers[index], 1, f"{index}_leaves")
        for index in problem.sharing.pairs
    ]
    model.add_cumulative(leaving, [1] * len(leaving), problem.sharing.buses)


def _in_interval(
    model: "CpModel", problem: Problem, cycle: "LinearExprT", busy: int, name: str
) -> "IntervalVar":
    """The phases that an operation takes which begins in a cycle, all of one interval."""
    interval = problem.interval
    longest = problem.latency + max(problem.registers)
    phase = model.new_int_var(0, interval - busy, f"p{name}")
    turn = model.new_int_var(0, longest // interval, f"t{name}")
    model.add(cycle == interval * turn + phase)
    return model.new_fixed_size_interval_var(phase, busy, f"i{name}")
