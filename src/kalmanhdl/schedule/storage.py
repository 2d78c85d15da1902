"""Where the operands of shared operators wait: registers, or a small memory before each port.

A file is a memory of one port of one operator. It is written in the cycle in which a value is there, and
read in the cycle in which the operator takes it. The values that it keeps come from few wires, of which no
two have a value in the same cycle of the interval. Values of steps in succession lie in ``turns`` places
one after the other, so that one may wait for longer than an interval.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from kalmanhdl.graph.operations import Coefficient, Constant, Flag, Input, State, StateFlag
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.results import Wire, Wires, source
from kalmanhdl.schedule.sharing import Unit, shifts, taken

# A memory for fewer values than this costs more than their registers.
_LEAST_ENTRIES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """An integer in a file, shifted left, from the end of cycle ``written`` until it is read in ``last``.

    It is all of ``values``, which came on one wire in one cycle.
    """

    values: tuple[int, ...]
    shift: int
    written: int
    last: int
    slot: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """A memory of ``slots`` times ``turns`` places, ``turns`` being a power of two."""

    entries: tuple[Entry, ...]
    slots: int
    turns: int

    @property
    def kept(self) -> Iterator[tuple[int, Entry]]:
        """Each value with its entry."""
        return ((value, entry) for entry in self.entries for value in entry.values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Read:
    """An operand that an operation takes in a cycle, from a file if it has a number."""

    operation: int
    value: int
    shift: int
    cycle: int
    file: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """What one port of a shared operator chooses among."""

    reads: tuple[Read, ...]
    files: tuple[File, ...]


def wires(plan: Plan) -> Wires:
    """The wires of a plan."""
    unit = {index: number for number, unit in enumerate(plan.units) for index in unit.operations}
    bus = {index: number for number, bus in enumerate(plan.buses) for index in bus}
    return Wires(plan.typed, plan.start, tuple(map(plan.end, range(len(plan.start)))), unit, bus)


def standing(plan: Plan) -> tuple[int, ...]:
    """The last cycle in which each value stands where it is made, without another register.

    Coefficients stand for ever. What comes with a step stands until the next step may come; the one
    track's states until they are stored anew; other values for their one cycle.
    """
    roots = dict(plan.typed.graph.states)
    found: list[int] = []
    for index, operation in enumerate(plan.typed.graph.operations):
        match operation:
            case Constant() | Coefficient():
                found.append(plan.latency)
            case Input() | Flag():
                found.append(plan.interval - 1)
            case State(name) | StateFlag(name) if plan.channels == 1 and name in roots:
                found.append(plan.end(roots[name]))
            case _:
                found.append(plan.end(index))
    return tuple(found)


def ports(plan: Plan, unit: Unit) -> tuple[Port, ...]:
    """The operand ports of a shared operator."""
    typed, stand, wire_of = plan.typed, standing(plan), wires(plan)
    kind = plan.sharing.operations[unit.kind]
    count = len(taken(typed, unit.operations[0])[0])
    reads: list[list[Read]] = [[] for _ in range(count)]
    for index in unit.operations:
        moved = shifts(typed, index, kind)
        for cycle, pair in enumerate(taken(typed, index), start=plan.start[index]):
            for port, (value, shift) in enumerate(zip(pair, moved, strict=True)):
                reads[port].append(Read(operation=index, value=value, shift=shift, cycle=cycle))
    return tuple(_port(plan, found, stand, wire_of) for found in reads)


def _port(plan: Plan, reads: list[Read], stand: tuple[int, ...], wire_of: Wires) -> Port:
    groups: dict[tuple[Wire, int], dict[int, Entry]] = {}
    for read in reads:
        if read.cycle > stand[read.value]:
            group = groups.setdefault((source(wire_of.of(read.value)), read.shift), {})
            written = plan.end(read.value)
            entry = group.get(written) or Entry(values=(), shift=read.shift, written=written, last=0)
            values = tuple(dict.fromkeys((*entry.values, read.value)))
            group[written] = replace(entry, values=values, last=max(entry.last, read.cycle))
    files = [
        _file(plan, entries)
        for entries in _written_apart(plan, groups.values())
        if len(entries) >= _LEAST_ENTRIES
    ]
    place = {(value, entry.shift): number for number, file in enumerate(files) for value, entry in file.kept}
    found = (
        replace(read, file=place.get((read.value, read.shift))) if read.cycle > stand[read.value] else read
        for read in reads
    )
    return Port(reads=tuple(found), files=tuple(files))


def _written_apart(plan: Plan, groups: Iterable[dict[int, Entry]]) -> list[list[Entry]]:
    """Groups of values put together as long as no two are written in one cycle of the interval."""
    files: list[tuple[set[int], list[Entry]]] = []
    for group in sorted(groups, key=len, reverse=True):
        phases = {entry.written % plan.interval for entry in group.values()}
        taken, entries = next((file for file in files if not file[0] & phases), (set[int](), list[Entry]()))
        if not entries:
            files.append((taken, entries))
        taken |= phases
        entries += group.values()
    return [entries for _, entries in files]


def _file(plan: Plan, entries: list[Entry]) -> File:
    """Slots given out first come, first served, to values whose times do not meet in any step."""
    longest = max(entry.last - entry.written for entry in entries)
    turns = 1
    while turns * plan.interval < longest:
        turns *= 2
    around = turns * plan.interval
    slots: list[list[Entry]] = []
    placed: list[Entry] = []
    for entry in sorted(entries, key=lambda e: (e.written % around, e.values)):
        slot = next((k for k, held in enumerate(slots) if not _meets(entry, held, around)), len(slots))
        if slot == len(slots):
            slots.append([])
        slots[slot].append(entry)
        placed.append(replace(entry, slot=slot))
    return File(entries=tuple(placed), slots=len(slots), turns=turns)


def _meets(entry: Entry, held: list[Entry], around: int) -> bool:
    """Whether a value is kept at a time at which another of the slot is, modulo ``around``."""
    return any(
        (other.written - entry.written) % around < entry.last - entry.written
        or (entry.written - other.written) % around < other.last - other.written
        for other in held
    )
