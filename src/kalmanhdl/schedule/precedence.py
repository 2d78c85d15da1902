"""What the cycles of shared operators and of states' reads must keep, as distances between them.

Between them lie operations with operators of their own, whose times follow from those they depend on. Since
placing them commutes with a shift by whole cycles and the latest operand decides, each path between two such
points is one whole number of cycles, whatever the schedule is.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from kalmanhdl.graph.operations import Constant, State, StateFlag
from kalmanhdl.schedule.placement import CYCLE_BITS, OFFSET_MASK, Pace, place
from kalmanhdl.schedule.sharing import Sharing

ISSUE = -1
"""The beginning of a step, from which inputs come: cycle 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """A state that is read, by its operation, and stored.

    Its new value is there in the latest of the cycles ``sources[p]`` after p, and can be read ``least``
    cycles later.
    """

    read: int
    sources: Mapping[int, int]
    least: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Precedence:
    """Points of a step: shared operations and states' reads, by operation, and the ``ISSUE``.

    ``after[k][p]`` is how many cycles after p the shared operation k can start at the earliest, ``ends[p]``
    after how many the last result that depends on p is there. Points that nothing depends on are not there.
    """

    shared: tuple[int, ...]
    after: Mapping[int, Mapping[int, int]]
    loops: tuple[Loop, ...]
    ends: Mapping[int, int]


def precedence(pace: Pace, sharing: Sharing) -> Precedence:
    """Follow the longest paths from every point to the next ones."""
    graph, kinds = pace.step.graph, sharing.kind()
    after: dict[int, dict[int, int]] = {}
    times: list[dict[int, int]] = []
    for index, operation in enumerate(graph.operations):
        ready = _latest(times, pace.step.awaited(index))
        if isinstance(operation, Constant):
            times.append({})
        elif index in kinds:
            after[index] = {p: (at >> CYCLE_BITS) + (at & OFFSET_MASK > 0) for p, at in ready.items()}
            times.append({index: (pace.registers[index] << CYCLE_BITS) + pace.lasts[index]})
        else:
            point = index if isinstance(operation, State | StateFlag) else ISSUE
            times.append(_through(pace, index, ready or {point: 0}))
    reads = {o.name: k for k, o in enumerate(graph.operations) if isinstance(o, State | StateFlag)}
    least = 1 + pace.step.context_overhead
    loops = (
        Loop(read=reads[name], sources=_cycles(times[root]), least=least)
        for name, root in graph.states
        if name in reads
    )
    return Precedence(
        shared=tuple(sorted(kinds)),
        after=after,
        loops=tuple(loops),
        ends=_cycles(_latest(times, ((root, 0) for root in graph.roots))),
    )


def _latest(times: list[dict[int, int]], awaited: Iterable[tuple[int, int]]) -> dict[int, int]:
    """The latest times, each less the lag that comes with its operation."""
    found: dict[int, int] = {}
    for index, lag in awaited:
        for point, at in times[index].items():
            found[point] = max(found.get(point, at - lag), at - lag)
    return found


def _through(pace: Pace, index: int, ready: Mapping[int, int]) -> dict[int, int]:
    registers, last, tail = pace.registers[index], pace.lasts[index], pace.step.tails[index]
    return {point: place(at, registers, last, tail, pace.budget)[1] for point, at in ready.items()}


def _cycles(times: Mapping[int, int]) -> dict[int, int]:
    return {point: at >> CYCLE_BITS for point, at in times.items()}
