"""How many shared operators there are, and how often a step can start on them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil

from kalmanhdl.errors import ScheduleError
from kalmanhdl.graph.operations import Multiply
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.attempt import Allocation, Attempt
from kalmanhdl.schedule.operator import picoseconds
from kalmanhdl.schedule.operators import is_multiplier, operators
from kalmanhdl.schedule.placement import pace, step_of
from kalmanhdl.schedule.sharing import Sharing, sharing
from kalmanhdl.schedule.solver import Effort
from kalmanhdl.schedule.wanted import Wanted, refused
from kalmanhdl.target.device import OPERANDS, Device

FEW = ("multiply", "divide", "reciprocal")
"""The operators of which there are few where the user leaves it open: larger than a choice of operands."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """A step to be scheduled at a period of so many picoseconds."""

    typed: TypedGraph | FloatGraph
    device: Device
    on_block: frozenset[int]
    wide: frozenset[int]
    period: int
    wanted: Wanted

    @cached_property
    def effort(self) -> Effort:
        """What the solver may still spend on it."""
        return Effort(self.wanted.solver_seconds)

    @cached_property
    def own(self) -> tuple[int, ...]:
        """Products that take no turns: ``wide``, and what costs less in logic than the choice of operands."""
        products = (k for k, o in enumerate(self.typed.graph.operations) if isinstance(o, Multiply))
        return tuple(k for k in products if k in self.wide or not is_multiplier(self.typed, k))

    def on(self, units: Mapping[str, int]) -> "Attempt":
        """The step on so many operators. Raises ScheduleError where they cannot be shared."""
        shared = sharing(self.typed, units, own=self.own, iterative=self.wanted.iterative)
        shared = replace(shared, two_steps=self._late(shared))
        step = step_of(self.typed, self.device, self.wanted.channels, self.on_block, shared)
        return Attempt(
            sharing=shared,
            pace=pace(step, max(self.period, step.shortest_period)),
            channels=self.wanted.channels,
            effort=self.effort,
        )

    def _late(self, shared: Sharing) -> frozenset[str]:
        """The kinds whose operands, slower to choose than the table says, are too slow for one cycle."""
        slower = self.device.derate.get(OPERANDS, 1.0)
        if slower == 1:
            return frozenset()
        budget = self.period - picoseconds(self.device.delay_ns("register", 1))
        made = operators(self.typed, self.device, self.on_block, shared)
        return frozenset(
            kind for kind, who in shared.operations.items() if max(made[who[0]].fetch) * slower > budget
        )


def allocated(task: Task) -> Allocation | None:
    """The step on the operators that were asked for; None where each operation has its own.

    Raises ScheduleError where no schedule was found.
    """
    found = _found(task)
    return None if found is None else found.sooner()


def _found(task: Task) -> Allocation | None:
    wanted = task.wanted
    if wanted.units is not None:
        return _on_given(task, wanted.units)
    if wanted.latency is not None:
        return _within_latency(task, wanted.latency)
    if wanted.interval is not None and wanted.interval > 1:
        interval = wanted.interval
        return _fewest(task, lambda attempt: attempt.at(interval))
    return None


def _on_given(task: Task, units: Mapping[str, int]) -> Allocation | None:
    attempt, interval, latency = task.on(units), task.wanted.interval, task.wanted.latency
    if not attempt.sharing.operations:
        return None
    found = attempt.fastest(latency) if interval is None else attempt.at(interval, latency)
    if found is not None and latency is not None and found.latency > latency:
        raise refused(
            "latency",
            f" is {latency}: with these units {found.latency} clocks were found, and "
            f"{found.least_latency} are needed at least: allow more clocks or more operators",
        )
    if found is None:
        listed = ", ".join(f"{count} {kind}" for kind, count in sorted(attempt.sharing.counts.items()))
        raise refused(
            "interval",
            f" is {interval}: no schedule on {listed} was found; the operators allow "
            f"{attempt.sharing.bound} at the least, the loop of the states "
            f"{-(-attempt.recurrence_bound // attempt.channels)}: allow more operators or a longer interval",
        )
    return found


def _within_latency(task: Task, latency: int) -> Allocation | None:
    def solve(attempt: Attempt) -> Allocation | None:
        interval = task.wanted.interval
        found = attempt.fastest(latency) if interval is None else attempt.at(interval, latency)
        return found if found and found.latency <= latency else None

    found = _fewest(task, solve)
    own = task.on({}).fastest()
    if found is None and own.latency > latency:
        raise refused(
            "latency",
            f" is {latency}: with an operator for every operation it is {own.latency} "
            "clocks: allow more, or a lower clock_mhz",
        )
    return found


def _fewest(task: Task, solve: Callable[[Attempt], Allocation | None]) -> Allocation | None:
    """The solution on the fewest operators that was found; None where each operation keeps its own."""
    most = _shareable(task)
    interval = task.wanted.interval or max(most.values(), default=1)
    least = {kind: ceil(count / interval) for kind, count in most.items()}
    counts, found = least, solve(task.on(least))
    while found is None and counts != most:
        counts = {kind: min(most[kind], 2 * count) for kind, count in counts.items()}
        found = solve(task.on(counts))
    for kind in counts:
        low = least[kind]
        while found and low < counts[kind]:
            middle = (low + counts[kind]) // 2
            if fewer := solve(task.on({**counts, kind: middle})):
                counts, found = {**counts, kind: middle}, fewer
            else:
                low = middle + 1
    return found if found and found.attempt.sharing.operations else None


def _shareable(task: Task) -> dict[str, int]:
    """How many operations there are of each kind of which there may be few operators."""
    found: dict[str, int] = {}
    for kind in FEW:
        try:
            shared = sharing(task.typed, {kind: 1}, own=task.own)
        except ScheduleError:
            # Reciprocals of different precision keep an operator each.
            continue
        if kind in shared.operations:
            found[kind] = len(shared.operations[kind])
    return found
