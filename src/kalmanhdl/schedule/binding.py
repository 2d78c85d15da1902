"""Which operator of its kind each operation takes: the one that has its operands, or their wires, already."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from kalmanhdl.graph.operations import Constant
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.results import Wire, Wires
from kalmanhdl.schedule.sharing import Sharing, Unit, order


@dataclass(slots=True)
class _Bound:
    """An operator on the way: its operations, the phases that they take, what each port can choose among."""

    kind: str
    operations: list[int] = field(default_factory=list)
    phases: set[int] = field(default_factory=set)
    ports: tuple[set[Wire | None], ...] = ()

    def growth(self, reads: Sequence[Wire | None]) -> int:
        """How many more choices its ports would have."""
        return sum(wire not in port for wire, port in zip(reads, self.ports, strict=True))


def bound(
    typed: TypedGraph | FloatGraph,
    starts: Sequence[int],
    ends: Sequence[int],
    interval: int,
    sharing: Sharing,
) -> tuple[Unit, ...]:
    """The operators with their operations.

    Operations are taken in the order of their cycles; each goes where it adds the fewest choices, of these
    to the operator that has fewest. No operator stays without one.
    """
    kinds, units = sharing.kind(), list[_Bound]()
    places: dict[str, range] = {}
    for kind, count in sharing.counts.items():
        places[kind] = range(len(units), len(units) + count)
        units += (_Bound(kind) for _ in range(count))
    given = _of_iterative(starts, interval, sharing, places)
    left = {kind: len(who) for kind, who in sharing.operations.items()}
    chosen: dict[int, int] = {}
    wires = Wires(typed, starts, ends, chosen)
    for index in sorted(kinds, key=lambda k: (starts[k], k)):
        reads = [
            None if isinstance(typed.graph.operations[k], Constant) else wires.of(k)
            for k in order(typed, index)
        ]
        phase = starts[index] % interval
        kind = kinds[index]
        free = [k for k in places[kind] if phase not in units[k].phases]
        if index in given:
            free = [given[index]]
        empty = [k for k in free if not units[k].operations]
        best = min(empty if left[kind] == len(empty) else free, key=lambda k: _cost(units[k], reads, k))
        left[kind] -= 1
        unit = units[best]
        unit.ports = unit.ports or tuple(set() for _ in reads)
        unit.operations.append(index)
        unit.phases.add(phase)
        for wire, port in zip(reads, unit.ports, strict=True):
            port.add(wire)
        chosen[index] = best
    return tuple(
        Unit(
            kind=unit.kind,
            operations=tuple(unit.operations),
            busy=sharing.cycles(unit.kind),
            steps=sharing.steps(unit.kind),
        )
        for unit in units
    )


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


def _cost(unit: _Bound, reads: Sequence[Wire | None], number: int) -> tuple[int, int, int]:
    if not unit.ports:
        # An operator without operations costs a choice at each port, as a new one at a busy one would.
        return len(reads), 0, number
    return unit.growth(reads), sum(map(len, unit.ports)), number
