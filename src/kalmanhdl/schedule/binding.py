"""Which operator of its kind each operation takes: the one that has its operands, or their wires, already."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from kalmanhdl.graph.operations import Constant
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.results import Wire, Wires, source
from kalmanhdl.schedule.sharing import Sharing, Unit, taken

# Pair after pair, what each port takes; nothing of constants.
_Reads = Sequence[tuple[Wire | None, ...]]


@dataclass(slots=True)
class _Bound:
    """An operator on the way: its operations, the phases that they take, what each port can choose among."""

    kind: str
    operations: list[int] = field(default_factory=list)
    phases: set[int] = field(default_factory=set)
    ports: tuple[set[Wire | None], ...] = ()
    buses: set[int] = field(default_factory=set)

    def growth(self, reads: _Reads, bus: int | None) -> int:
        """How many more choices its ports would have, and the bus on which it leaves."""
        new = (set(wires) - port for wires, port in zip(zip(*reads, strict=True), self.ports, strict=True))
        return sum(map(len, new)) + (bus is not None and bus not in self.buses)


def bound(
    typed: TypedGraph | FloatGraph,
    starts: Sequence[int],
    ends: Sequence[int],
    interval: int,
    sharing: Sharing,
    buses: Sequence[tuple[int, ...]],
) -> tuple[Unit, ...]:
    """The operators with their operations.

    Operations are taken in the order of their cycles; each goes where it adds the fewest choices, of these
    to the operator that has fewest. No operator stays without one. Where some take several cycles in a row
    all are taken in the order of their phases: then an operator that is free in the first stays free.
    """
    kinds, units = sharing.kind(), list[_Bound]()
    places: dict[str, range] = {}
    for kind, count in sharing.counts.items():
        places[kind] = range(len(units), len(units) + count)
        units += (_Bound(kind) for _ in range(count))
    given = _of_iterative(starts, interval, sharing, places)
    left = {kind: len(who) for kind, who in sharing.operations.items()}
    chosen: dict[int, int] = {}
    leaves = {index: number for number, bus in enumerate(buses) for index in bus}
    around = interval if sharing.pairs else max(starts) + 1
    for index in sorted(kinds, key=lambda k: (starts[k] % around, k)):
        # New for each: more operations have their operators, so that more wires are known.
        wires = Wires(typed, starts, ends, chosen, leaves)
        reads = [
            tuple(
                None if isinstance(typed.graph.operations[k], Constant) else source(wires.of(k)) for k in pair
            )
            for pair in taken(typed, index)
        ]
        phase = starts[index] % interval
        kind = kinds[index]
        free = [k for k in places[kind] if phase not in units[k].phases]
        if index in given:
            free = [given[index]]
        empty = [k for k in free if not units[k].operations]
        bus = leaves.get(index)
        best = min(empty if left[kind] == len(empty) else free, key=lambda k: _cost(units[k], reads, bus, k))
        left[kind] -= 1
        unit = units[best]
        unit.ports = unit.ports or tuple(set() for _ in reads[0])
        unit.operations.append(index)
        unit.phases.update(range(phase, phase + len(reads)))
        unit.buses |= set() if bus is None else {bus}
        for pair in reads:
            for wire, port in zip(pair, unit.ports, strict=True):
                port.add(wire)
        chosen[index] = best
    return tuple(
        Unit(
            kind=unit.kind,
            operations=tuple(unit.operations),
            busy=sharing.busy.get(unit.kind, 1),
            steps=sharing.steps(unit.kind),
        )
        for unit in units
    )


def carried(ends: Sequence[int], interval: int, sharing: Sharing) -> tuple[tuple[int, ...], ...]:
    """The sums of products that leave on each bus: of one phase each on another, the lowest first."""
    buses: list[list[int]] = [[] for _ in range(sharing.buses)]
    taken = [0] * interval
    for index in sorted(sharing.pairs, key=lambda k: (ends[k] % interval, k)):
        phase = ends[index] % interval
        buses[taken[phase]].append(index)
        taken[phase] += 1
    return tuple(tuple(bus) for bus in buses if bus)


def _of_iterative(
    starts: Sequence[int], interval: int, sharing: Sharing, places: dict[str, range]
) -> dict[int, int]:
    """The operator of each operation that takes one for several cycles: the one that was free first."""
    found: dict[int, int] = {}
    for kind, busy in sharing.busy.items():
        free = dict.fromkeys(places[kind], 0)
        for index in sorted(sharing.operations[kind], key=lambda k: (starts[k] % interval, k)):
            chosen = min(free, key=lambda unit: (free[unit], unit))
            found[index], free[chosen] = chosen, starts[index] % interval + busy
    return found


def _cost(unit: _Bound, reads: _Reads, bus: int | None, number: int) -> tuple[int, int, int]:
    if not unit.ports:
        # An operator without operations costs a choice at each port, as a new one at a busy one would.
        return len({(port, wire) for pair in reads for port, wire in enumerate(pair)}), 0, number
    return unit.growth(reads, bus), sum(map(len, unit.ports)), number
