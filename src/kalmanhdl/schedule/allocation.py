"""How many shared operators there are, and how often a step can start on them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil

from kalmanhdl.errors import ScheduleError
from kalmanhdl.graph.operations import Multiply
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.operators import is_multiplier
from kalmanhdl.schedule.placement import CYCLE_BITS, Pace, pace, step_of
from kalmanhdl.schedule.recurrence import recurrence
from kalmanhdl.schedule.sharing import Sharing, sharing
from kalmanhdl.schedule.turns import Turns, in_turn, priorities
from kalmanhdl.schedule.wanted import Wanted
from kalmanhdl.target.device import Device

# Operations that are placed in all tries together before an interval is given up.
_EFFORT = 20_000
_MOST_TRIES = 16

FEW = ("multiply", "divide", "reciprocal")
"""The operators of which there are few where the user leaves it open: larger than a choice of operands."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """A step to be scheduled at a period of so many picoseconds."""

    typed: TypedGraph | FloatGraph
    device: Device
    on_block: frozenset[int]
    period: int
    wanted: Wanted

    @cached_property
    def small(self) -> tuple[int, ...]:
        """Products that cost less in logic than the choice of operands would."""
        operations = enumerate(self.typed.graph.operations)
        return tuple(k for k, o in operations if isinstance(o, Multiply) and not is_multiplier(self.typed, k))

    def on(self, units: Mapping[str, int]) -> "Attempt":
        """The step on so many operators. Raises ScheduleError where they cannot be shared."""
        shared = sharing(self.typed, units, own=self.small)
        step = step_of(self.typed, self.device, self.wanted.channels, self.on_block, shared)
        return Attempt(
            sharing=shared,
            pace=pace(step, max(self.period, step.shortest_period)),
            channels=self.wanted.channels,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Allocation:
    """Shared operators, and a schedule on them."""

    sharing: Sharing
    pace: Pace
    interval: int
    turns: Turns
    recurrence_bound: int

    @property
    def latency(self) -> int:
        """Cycles from the issue of a step to the last of its results."""
        roots = self.pace.step.graph.roots
        return 1 + max((self.turns.times[root] >> CYCLE_BITS for root in roots), default=0)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """A step on a number of shared operators."""

    sharing: Sharing
    pace: Pace
    channels: int

    @cached_property
    def recurrence_bound(self) -> int:
        """The least distance of two steps of a track, whatever the number of operators."""
        return recurrence(self.pace).bound

    @property
    def least_interval(self) -> int:
        """No schedule has a shorter interval."""
        return max(self.sharing.bound, -(-self.recurrence_bound // self.channels))

    @cached_property
    def orders(self) -> tuple[list[int], ...]:
        """Orders of urgency to try."""
        tries = max(2, min(_MOST_TRIES, _EFFORT // len(self.pace.registers)))
        return tuple(priorities(self.pace, tries))

    def at(self, interval: int) -> Allocation | None:
        """A schedule at an interval, if one was found."""
        if interval < self.least_interval:
            return None
        longest = interval * self.channels
        found = (in_turn(self.pace, self.sharing, interval, longest, order) for order in self.orders)
        turns = next((turns for turns in found if turns), None)
        return None if turns is None else self._allocation(interval, turns)

    def fastest(self) -> Allocation:
        """The schedule of the least interval that was found."""
        # Without an end of the interval nothing waits for its phase.
        forever = sum(self.pace.registers) + 2 * len(self.pace.registers)
        free = in_turn(self.pace, self.sharing, forever, None, self.orders[0])
        assert free is not None
        low = self.least_interval
        high = max(low, -(-free.distance // self.channels))
        best = self.at(high)
        while best is None:
            low, high = high + 1, high + max(1, high // 8)
            best = self.at(high)
        while low < high:
            middle = (low + high) // 2
            if found := self.at(middle):
                high, best = middle, found
            else:
                low = middle + 1
        return best

    def _allocation(self, interval: int, turns: Turns) -> Allocation:
        return Allocation(
            sharing=self.sharing,
            pace=self.pace,
            interval=interval,
            turns=turns,
            recurrence_bound=self.recurrence_bound,
        )


def allocated(task: Task) -> Allocation | None:
    """The step on the operators that were asked for; None where each operation has its own.

    Raises ScheduleError where no schedule was found.
    """
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
    attempt, interval = task.on(units), task.wanted.interval
    if not attempt.sharing.operations:
        return None
    if interval is None:
        return attempt.fastest()
    found = attempt.at(interval)
    if found is None:
        listed = ", ".join(f"{count} {kind}" for kind, count in sorted(attempt.sharing.counts.items()))
        raise ScheduleError(
            f"architecture.interval is {interval}: no schedule on {listed} was found; the operators allow "
            f"{attempt.sharing.bound} at the least, the loop of the states "
            f"{-(-attempt.recurrence_bound // attempt.channels)}: allow more operators or a longer interval"
        )
    return found


def _within_latency(task: Task, latency: int) -> Allocation | None:
    def solve(attempt: Attempt) -> Allocation | None:
        interval = task.wanted.interval
        found = attempt.fastest() if interval is None else attempt.at(interval)
        return found if found and found.latency <= latency else None

    found = _fewest(task, solve)
    own = task.on({}).fastest()
    if found is None and own.latency > latency:
        raise ScheduleError(
            f"architecture.latency is {latency}: with an operator for every operation it is {own.latency} "
            "clocks: allow more, or a lower clock_mhz"
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
    return found if found and found.sharing.operations else None


def _shareable(task: Task) -> dict[str, int]:
    """How many operations there are of each kind of which there may be few operators."""
    found: dict[str, int] = {}
    for kind in FEW:
        try:
            shared = sharing(task.typed, {kind: 1}, own=task.small)
        except ScheduleError:
            # Reciprocals of different precision keep an operator each.
            continue
        if kind in shared.operations:
            found[kind] = len(shared.operations[kind])
    return found
