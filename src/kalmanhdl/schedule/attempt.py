"""A step on a number of shared operators: its schedules, by list and by solver."""

from dataclasses import dataclass, replace
from functools import cached_property

from kalmanhdl.schedule.placement import CYCLE_BITS, Pace, least_latency
from kalmanhdl.schedule.precedence import Precedence, precedence
from kalmanhdl.schedule.recurrence import Recurrence, recurrence
from kalmanhdl.schedule.sharing import Sharing
from kalmanhdl.schedule.solver import MOST_SHARED, Effort, Problem, solve
from kalmanhdl.schedule.turns import Turns, at_cycles, in_turn, priorities

# Operations that are placed in all tries together before an interval is given up.
_EFFORT = 20_000
_MOST_TRIES = 16

# What one question to the solver may take of the effort that is left, and how many intervals it is asked for.
_PART = 0.4
_MOST_INTERVALS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Allocation:
    """Shared operators, and a schedule on them.

    No schedule on them has an interval below ``least_interval``, or, at this one, a latency below
    ``least_latency``.
    """

    attempt: "Attempt"
    interval: int
    turns: Turns
    least_interval: int
    least_latency: int

    @property
    def latency(self) -> int:
        """Cycles from the issue of a step to the last of its results."""
        roots = self.attempt.pace.step.graph.roots
        return 1 + max((self.turns.times[root] >> CYCLE_BITS for root in roots), default=0)

    def sooner(self) -> "Allocation":
        """The schedule at the same interval whose last result comes soonest, as far as one was found."""
        attempt = self.attempt
        if self.latency == self.least_latency or not attempt.solvable:
            return self
        hint = dict(enumerate(self.turns.starts))
        answer = solve(attempt.problem(self.interval, self.latency), attempt.effort, 1.0, hint)
        if answer.cycles is None:
            return self
        turns = at_cycles(attempt.pace, attempt.sharing, answer.cycles)
        least = max(self.least_latency, answer.latency)
        better = replace(self, turns=turns, least_latency=least)
        return better if better.latency < self.latency else replace(self, least_latency=least)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """A step on a number of shared operators.

    The list schedule comes first; where it misses a bound, and the step is not too large, the solver follows.
    """

    sharing: Sharing
    pace: Pace
    channels: int
    effort: Effort

    @cached_property
    def recurrence(self) -> Recurrence:
        """The loops of the states."""
        return recurrence(self.pace)

    @property
    def recurrence_bound(self) -> int:
        """The least distance of two steps of a track, whatever the number of operators."""
        return self.recurrence.bound

    @property
    def least_interval(self) -> int:
        """No schedule has a shorter interval."""
        return max(self.sharing.bound, -(-self.recurrence_bound // self.channels))

    @cached_property
    def points(self) -> Precedence:
        """What shared operations wait for."""
        return precedence(self.pace, self.sharing)

    @cached_property
    def solvable(self) -> bool:
        """Whether the solver is asked at all."""
        shared = sum(map(len, self.sharing.operations.values()))
        return 0 < shared <= MOST_SHARED and self.effort.seconds > 0

    @cached_property
    def orders(self) -> tuple[list[int], ...]:
        """Orders of urgency to try."""
        tries = max(2, min(_MOST_TRIES, _EFFORT // len(self.pace.registers)))
        return tuple(priorities(self.pace, tries))

    def at(self, interval: int, latency: int | None = None) -> Allocation | None:
        """A schedule at an interval, of a latency that is allowed, if one was found."""
        found = self._listed(interval, latency)
        if found is not None and (latency is None or found.latency <= latency):
            return found
        limit = latency or (found.latency if found else 2 * self._unhurried.latency)
        return self._solved(interval, limit)

    def fastest(self, latency: int | None = None) -> Allocation:
        """The schedule of the least interval that was found; of those within a latency, if there are any."""
        listed = self._fastest_listed()
        impossible = True
        for interval in range(self.least_interval, listed.interval)[:_MOST_INTERVALS]:
            if found := self._solved(interval, latency or listed.latency + 2 * interval):
                return replace(found, least_interval=interval if impossible else self.least_interval)
            impossible = impossible and self._impossible(interval)
        if latency is not None and listed.latency > latency:
            listed = self._solved(listed.interval, latency) or self._within(latency, listed)
        every = listed.interval - self.least_interval <= _MOST_INTERVALS
        return replace(listed, least_interval=listed.interval) if impossible and every else listed

    def _listed(self, interval: int, latency: int | None = None) -> Allocation | None:
        """The first list schedule that there is, or, of a latency that is asked for, the first within it."""
        if interval < self.least_interval:
            return None
        longest, first = interval * self.channels, None
        for order in self.orders:
            turns = in_turn(self.pace, self.sharing, interval, longest, order)
            found = None if turns is None else self._allocation(interval, turns)
            if found is not None and (latency is None or found.latency <= latency):
                return found
            first = first or found
        return first

    def _within(self, latency: int, listed: Allocation) -> Allocation:
        """The list schedule of the least interval whose latency is allowed; the one at hand if none is.

        In an interval as long as the latency no step waits for the one before.
        """
        low, high, best = listed.interval + 1, max(listed.interval, latency), listed
        while low <= high:
            middle = (low + high) // 2
            found = self._listed(middle, latency)
            if found is not None and found.latency <= latency:
                high, best = middle - 1, found
            else:
                low = middle + 1
        return best

    def _solved(self, interval: int, latency: int) -> Allocation | None:
        if interval < self.least_interval or not self.solvable:
            return None
        answer = solve(self.problem(interval, latency), self.effort, _PART)
        if answer.cycles is None:
            return None
        return self._allocation(interval, at_cycles(self.pace, self.sharing, answer.cycles))

    def _impossible(self, interval: int) -> bool:
        """Whether no latency allows an interval, as far as that was proven."""
        if not self.solvable:
            return False
        problem = self.problem(interval, 1)
        return solve(replace(problem, latency=problem.unlimited), self.effort, _PART).impossible

    def problem(self, interval: int, latency: int) -> Problem:
        """The solver's task: a schedule at an interval, within a latency."""
        return Problem(
            points=self.points,
            sharing=self.sharing,
            registers=self.pace.registers,
            interval=interval,
            longest=interval * self.channels,
            latency=latency,
        )

    @cached_property
    def _unhurried(self) -> Allocation:
        """The list schedule of a step that nothing follows."""
        # Without an end of the interval nothing waits for its phase.
        forever = sum(self.pace.registers) + 2 * len(self.pace.registers)
        turns = in_turn(self.pace, self.sharing, forever, None, self.orders[0])
        assert turns is not None
        return self._allocation(forever, turns)

    def _fastest_listed(self) -> Allocation:
        low = self.least_interval
        high = max(low, -(-self._unhurried.turns.distance // self.channels))
        best = self._listed(high)
        while best is None:
            low, high = high + 1, high + max(1, high // 8)
            best = self._listed(high)
        while low < high:
            middle = (low + high) // 2
            if found := self._listed(middle):
                high, best = middle, found
            else:
                low = middle + 1
        return best

    def _allocation(self, interval: int, turns: Turns) -> Allocation:
        return Allocation(
            attempt=self,
            interval=interval,
            turns=turns,
            least_interval=self.least_interval,
            least_latency=least_latency(self.pace, self.recurrence.reads(interval * self.channels)),
        )
