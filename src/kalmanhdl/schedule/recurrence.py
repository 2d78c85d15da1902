"""How soon a step can follow the step before it: the loops through the states.

An edge from state s to state t weighs the cycles from reading s to storing what becomes of t. The
greatest mean weight of a loop bounds the distance of two steps of one track.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kalmanhdl.graph.operations import State, StateFlag, is_flag
from kalmanhdl.schedule.placement import CYCLE_BITS, OFFSET_MASK, Pace

Cycles = npt.NDArray[np.int64]
# No path leads from one to the other; half the range, so that sums stay below zero.
_NO_PATH = np.int64(-(1 << 61))
# Operands that are taken late may be there before their operation starts: times down to this are paths.
_EARLIEST = np.int64(-(1 << 60))


@dataclass(frozen=True, slots=True)
class Recurrence:
    """The states of a step at one pace.

    ``weights[s, t]`` counts the cycles from reading state s until state t can be read again, negative
    and huge where t does not depend on s; ``from_inputs[t]`` counts them from the issue of the step.
    ``numbers`` are the states that are no flags. ``least`` is the least distance that any state
    allows, one cycle and the context's overhead.
    """

    names: tuple[str, ...]
    operations: tuple[int | None, ...]
    numbers: tuple[int, ...]
    weights: Cycles
    from_inputs: Cycles
    least: int

    @property
    def bound(self) -> int:
        """The least distance, in cycles, of two steps of one track."""
        return max(self.least, _greatest_mean(self.weights))

    @property
    def single_cycle(self) -> bool:
        """Whether steps follow each other at once, and all numbers are new in the cycle of the inputs."""
        ends = np.maximum(self.weights.max(axis=0, initial=0), self.from_inputs)
        return self.bound == 1 and bool((ends[list(self.numbers)] <= 1).all())

    def reads(self, distance: int) -> dict[int, int]:
        """The earliest cycles in which the states can be read, by operation, for a distance >= bound."""
        cycles = np.maximum(self.from_inputs - distance, 0)
        for _ in self.names:
            later = np.maximum(cycles, (cycles[:, None] + self.weights).max(axis=0) - distance)
            if (later == cycles).all():
                break
            cycles = later
        found = zip(self.operations, cycles.tolist(), strict=True)
        return {index: int(cycle) for index, cycle in found if index is not None}

    def loop(self, distance: int) -> tuple[str, ...]:
        """The states of a loop that forbids a distance, in their order; none if no loop does."""
        count = len(self.names)
        reach, before = np.zeros(count, dtype=np.int64), np.full(count, -1)
        changed = np.zeros(count, dtype=bool)
        for _ in range(count):
            candidates = reach[:, None] + self.weights - distance
            best = candidates.argmax(axis=0)
            longest = candidates[best, np.arange(count)]
            changed = longest > reach
            before[changed] = best[changed]
            reach = np.maximum(reach, longest)
        return self._traced(before, int(changed.argmax())) if changed.any() else ()

    def _traced(self, before: npt.NDArray[np.int64], state: int) -> tuple[str, ...]:
        for _ in self.names:
            state = int(before[state])
        loop = [state]
        while (state := int(before[state])) != loop[0]:
            loop.append(state)
        loop.reverse()
        first = loop.index(min(loop))
        return tuple(self.names[k] for k in (*loop[first:], *loop[:first]))


def recurrence(pace: Pace) -> Recurrence:
    """Follow the longest paths from every state, and from the inputs, to every new state."""
    graph = pace.step.graph
    names = tuple(name for name, _ in graph.states)
    sources = {o.name: k for k, o in enumerate(graph.operations) if isinstance(o, State | StateFlag)}
    times = _times(pace, {sources[name]: s for s, name in enumerate(names) if name in sources}, len(names))
    least = 1 + pace.step.context_overhead
    ends = (
        np.array([times[root] for _, root in graph.states], dtype=np.int64)
        .reshape(len(names), len(names) + 1)
        .T
    )
    weights = np.where(ends < _EARLIEST, _NO_PATH, (ends >> CYCLE_BITS) + least)
    return Recurrence(
        names=names,
        operations=tuple(sources.get(name) for name in names),
        numbers=tuple(s for s, (_, root) in enumerate(graph.states) if not is_flag(graph.operations[root])),
        weights=weights[:-1],
        from_inputs=weights[-1] if len(names) else np.zeros(0, dtype=np.int64),
        least=least if names else 1,
    )


def _times(pace: Pace, columns: dict[int, int], count: int) -> list[Cycles]:
    """The time of every operation, one element a source: the states, then the inputs."""
    times: list[Cycles] = []
    for index in range(len(pace.step.operands)):
        ready: Cycles | None = None
        for k, lag in pace.step.awaited(index):
            there = times[k] - lag if lag else times[k]
            ready = there if ready is None else np.maximum(ready, there)
        if ready is None:
            ready = _source(columns.get(index, count), count)
        times.append(_placed(pace, index, ready))
    return times


def _source(column: int, count: int) -> Cycles:
    times = np.full(count + 1, _NO_PATH, dtype=np.int64)
    times[column] = 0
    return times


def _placed(pace: Pace, index: int, ready: Cycles) -> Cycles:
    registers, last, tail = pace.registers[index], pace.lasts[index], pace.step.tails[index]
    if not registers and last + tail == 0:
        return ready
    offset = ready & OFFSET_MASK
    full = offset + ((last + tail) if not registers else pace.budget) > pace.budget
    begin = np.where(full & (offset > 0), ready - offset + (1 << CYCLE_BITS), ready)
    times: Cycles = begin + (registers << CYCLE_BITS) + last
    return np.where(ready < _EARLIEST, _NO_PATH, times)


def _greatest_mean(weights: Cycles) -> int:
    """The greatest mean weight of a loop, rounded up; 0 without a loop (Karp 1978)."""
    count = len(weights)
    walks = [np.zeros(count, dtype=np.int64)]
    for _ in range(count):
        longest = (walks[-1][:, None] + weights).max(axis=0)
        walks.append(np.where(longest < 0, _NO_PATH, longest))
    if not count or (walks[-1] < 0).all():
        return 0
    closed = walks[-1] >= 0
    means = [
        np.where(walk[closed] < 0, np.iinfo(np.int64).max, -((walk - walks[-1])[closed] // (count - k)))
        for k, walk in enumerate(walks[:-1])
    ]
    return int(np.min(means, axis=0).max())
