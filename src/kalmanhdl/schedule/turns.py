"""Operations in turn on few operators: a list schedule modulo the interval.

Operations are placed one by one, the most urgent first, each in the earliest cycle in which its operands
are there and an operator has no other operation in that cycle of the interval (Rau, Iterative modulo
scheduling, 1994, without its backtracking: the interval grows instead).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from random import Random

from kalmanhdl.graph.operations import Constant, State, StateFlag, is_flag
from kalmanhdl.schedule.placement import CYCLE_BITS, OFFSET_MASK, Pace, place
from kalmanhdl.schedule.sharing import Sharing

# How often the states' reads are moved so that steps of one track can follow each other.
_MOVES = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Turns:
    """Start cycles and times of all operations, and the distance that they allow two steps of a track."""

    starts: list[int]
    times: list[int]
    distance: int


def in_turn(
    pace: Pace, sharing: Sharing, interval: int, longest: int | None, priority: list[int]
) -> Turns | None:
    """A schedule in which steps start every ``interval`` cycles, and those of a track within ``longest``.

    None for ``longest`` leaves the distance open. ``priority`` orders the operations, operands first.
    Returns None where none was found.
    """
    if sharing.bound > interval:
        return None
    kinds, loops, least = sharing.kind(), _loops(pace), _least(pace)
    reads = {read: 0 for read, _ in loops}
    for _ in range(_MOVES):
        placed = _placed(pace, sharing, kinds, interval, reads, priority)
        if placed is None:
            return None
        starts, times = placed
        stored = {read: (times[root] >> CYCLE_BITS) + least for read, root in loops}
        distance = max((after - reads[read] for read, after in stored.items()), default=least)
        if longest is None or distance <= longest:
            return Turns(starts=starts, times=times, distance=max(distance, least))
        if longest < least:
            return None
        later = {read: max(reads[read], after - longest) for read, after in stored.items()}
        if any(later[read] > stored[read] - least for read, _ in loops):
            return None
        reads |= later
    return None


def at_cycles(pace: Pace, sharing: Sharing, cycles: Mapping[int, int]) -> Turns:
    """The schedule in which shared operations start, and states are read, in given cycles, by operation.

    Everything else is placed as soon as its operands are there.
    """
    kinds, operations, step = sharing.kind(), pace.step.graph.operations, pace.step
    starts, times = list[int](), list[int]()
    for index in range(len(operations)):
        registers, last = pace.registers[index], pace.lasts[index]
        if index in kinds:
            start, time = cycles[index], ((cycles[index] + registers) << CYCLE_BITS) + last
        else:
            ready = step.ready(index, times, cycles.get(index, 0) << CYCLE_BITS)
            if isinstance(operations[index], Constant):
                ready = 0
            start, time = place(ready, registers, last, step.tails[index], pace.budget)
        starts.append(start)
        times.append(time)
    least = _least(pace)
    distances = ((times[root] >> CYCLE_BITS) + least - cycles[read] for read, root in _loops(pace))
    return Turns(starts=starts, times=times, distance=max((least, *distances)))


def _loops(pace: Pace) -> list[tuple[int, int]]:
    """The operation that reads each state, and the one that gives its next value."""
    graph = pace.step.graph
    reads = {o.name: k for k, o in enumerate(graph.operations) if isinstance(o, State | StateFlag)}
    return [(reads[name], root) for name, root in graph.states if name in reads]


def _least(pace: Pace) -> int:
    """The cycles from storing a state until it can be read."""
    return 1 + pace.step.context_overhead if pace.step.graph.states else 1


def _placed(
    pace: Pace,
    sharing: Sharing,
    kinds: Mapping[int, str],
    interval: int,
    reads: Mapping[int, int],
    priority: list[int],
) -> tuple[list[int], list[int]] | None:
    """Start cycles and times; None where an operation finds no cycles in a row any more."""
    counts = sharing.counts
    operations, step, budget = pace.step.graph.operations, pace.step, pace.budget
    registers, lasts, tails = pace.registers, pace.lasts, pace.step.tails
    starts, times = [0] * len(operations), [0] * len(operations)
    taken = {kind: [0] * interval for kind in counts}
    leaving = [0] * interval
    for index in priority:
        ready = step.ready(index, times, reads.get(index, 0) << CYCLE_BITS)
        if isinstance(operations[index], Constant):
            ready = 0
        kind = kinds.get(index)
        if kind is None:
            starts[index], times[index] = place(ready, registers[index], lasts[index], tails[index], budget)
            continue
        cycle = max(0, (ready >> CYCLE_BITS) + (ready & OFFSET_MASK > 0))
        used, count = taken[kind], counts[kind]
        if index in sharing.pairs or sharing.cycles(kind, index) > 1:
            full = [sums >= sharing.buses for sums in leaving] if index in sharing.pairs else None
            found = _free(used, count, sharing.cycles(kind, index), cycle, full, registers[index])
            if found is None:
                return None
            cycle = found
            if full is not None:
                leaving[(cycle + registers[index]) % interval] += 1
        else:
            while used[cycle % interval] >= count:
                cycle += 1
            used[cycle % interval] += 1
        starts[index], times[index] = cycle, ((cycle + registers[index]) << CYCLE_BITS) + lasts[index]
    return starts, times


def _free(
    used: list[int], count: int, busy: int, cycle: int, full: list[bool] | None, registers: int
) -> int | None:
    """The first cycle from one on in which an operator is free for so long, which is then taken.

    What ends so many ``registers`` later does not do so in a phase that is ``full``.
    """
    interval = len(used)
    for start in range(cycle, cycle + interval):
        phase = start % interval
        if full is not None and full[(start + registers) % interval]:
            continue
        if phase + busy <= interval and max(used[phase : phase + busy]) < count:
            for k in range(phase, phase + busy):
                used[k] += 1
            return start
    return None


def priorities(pace: Pace, count: int) -> Iterator[list[int]]:
    """Orders of urgency to try: by the longest way to a new state, then with chance mixed in."""
    urgency, way = _ways(pace)
    indices = range(len(urgency))
    yield sorted(indices, key=lambda k: (-urgency[k], -way[k], k))
    yield sorted(indices, key=lambda k: (-way[k], k))
    random = Random(1)
    for _ in range(count - 2):
        yield _mixed(pace, random)


def _mixed(pace: Pace, random: Random) -> list[int]:
    """An order by ways whose parts were made up to a fifth longer, the operands still first."""
    lengths = [length * (1 + 0.2 * random.random()) for length in _lengths(pace)]
    ways = [0.0] * len(lengths)
    for index in reversed(range(len(lengths))):
        ways[index] += lengths[index] + 1
        for k in pace.step.operands[index]:
            ways[k] = max(ways[k], ways[index])
    return sorted(range(len(ways)), key=lambda k: (-ways[k], k))


def _lengths(pace: Pace) -> list[int]:
    held = zip(pace.registers, pace.lasts, strict=True)
    return [registers * pace.budget + last for registers, last in held]


def _ways(pace: Pace) -> tuple[list[int], list[int]]:
    """Picoseconds from taking its operands to the last number of a state, and to anything, that uses each.

    Nothing where an operation serves no state.
    """
    graph, lengths = pace.step.graph, _lengths(pace)
    numbers = {root for _, root in graph.states if not is_flag(graph.operations[root])}
    urgency, way = [0] * len(lengths), [0] * len(lengths)
    for index in reversed(range(len(lengths))):
        way[index] += lengths[index] + 1
        if index in numbers or urgency[index]:
            urgency[index] += lengths[index] + 1
        for k in pace.step.operands[index]:
            way[k] = max(way[k], way[index])
            urgency[k] = max(urgency[k], urgency[index])
    return urgency, way
