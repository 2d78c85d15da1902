"""What a path through a placed core runs through: names of cells and nets, read back as parts of a plan.

Yosys names a table of a lookup by the register that it drives, and a wire by one of its aliases. So only
names inside an operator say where the path is; for the rest the register at its end does, and the plan
knows what leads there.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from kalmanhdl.graph.operations import Constant, operands
from kalmanhdl.rtl.context import banks
from kalmanhdl.rtl.names import identifier, operation_names
from kalmanhdl.schedule.operator import Operator, picoseconds
from kalmanhdl.schedule.operators import operators
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.storage import Port, ports
from kalmanhdl.target import DERATED, OPERANDS, Device
from kalmanhdl.toolchain.nextpnr import Hop

# Registers that take the operands of a shared operator; its core's ports are other names of theirs.
_TAKEN = re.compile(r"(taken_\d+|taken_subtract|core\.(a|b|start|dividend|divisor))(?![A-Za-z0-9])")
_CORES = ("_multiplier.", "_divider.", "_core.")
_WRITE = re.compile(r"context_write_(enable|track)_c\d+")


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A kind of operator on a path, the origin of the operation that takes most, and the delay in ns."""

    kind: str
    name: str
    delay_ns: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What a path runs through: kinds of operators, that with most of the delay first, and operations.

    Nothing where the path is none of the datapath's, so that latency is no remedy. ``expected_ns`` is what
    the schedule took the stage for.
    """

    parts: tuple[Part, ...] = ()
    operations: tuple[int, ...] = ()
    expected_ns: float = 0.0
    measured_ns: float = 0.0


class Reader:
    """Reads the paths of a plan's placed hardware."""

    def __init__(self, plan: Plan, device: Device) -> None:
        self._plan = plan
        self._library: tuple[Operator, ...] = operators(
            plan.typed, device, plan.on_multiplier_block, plan.sharing
        )
        self._register = picoseconds(device.delay_ns("register", 1))
        self._users = plan.typed.graph.users
        self._names = operation_names(plan.typed.graph)
        self._index = {name: index for index, name in enumerate(self._names)}
        self._units = {f"{unit.kind}_{number}": unit for number, unit in enumerate(plan.units)}

    def read(self, path: Sequence[Hop]) -> Reading:
        """What a path runs through."""
        if not path:
            return Reading()
        begin, end = (_within(hop.cell) for hop in (path[0], path[-1]))
        total = sum(hop.delay_ns for hop in path)
        if self._chooses(begin, end):
            unit = self._units[_unit_of(end, self._units) or ""]
            part = Part(kind=OPERANDS, name=f"operands of {unit.kind}", delay_ns=round(total, 3))
            fetch = (self._register + max(self._library[unit.operations[0]].fetch)) / 1000
            return Reading(parts=(part,), operations=unit.operations, expected_ns=fetch, measured_ns=total)
        named, rest = dict[int, float](), 0.0
        for hop in path[1:]:
            index = self._inside(_within(hop.net or hop.cell))
            if index is None:
                rest += hop.delay_ns
            else:
                named[index] = named.get(index, 0.0) + hop.delay_ns
        chain = self._leading_to(begin, end, named)
        whole = sum(self._last(index) for index in chain)
        for index in chain if whole else ():
            named[index] = named.get(index, 0.0) + rest * self._last(index) / whole
        inside = [max(self._library[k].derated(self._plan.registers[k])) for k in named]
        return Reading(
            parts=self._sorted(named),
            operations=tuple(sorted(named)),
            expected_ns=(self._register + max(whole, *inside, 0)) / 1000,
            measured_ns=total,
        )

    def shape(self, operations: Iterable[int]) -> list[tuple[int, list[int]]]:
        """For each operation its registers, and the operations that follow it without one."""
        return [(self._plan.registers[k], list(self._following(k))) for k in operations]

    def full(self, kind: str, operations: Iterable[int]) -> bool:
        """Whether those of a kind hold all the registers that they can, the one behind them included."""
        those = [k for k in operations if self._library[k].kind == kind]
        held = (self._plan.registers[k] == self._library[k].capacity for k in those)
        return bool(those) and all(self._library[k].derate > 1 for k in those) and all(held)

    def _following(self, index: int) -> Iterable[int]:
        return (user for user in self._users[index] if self._plan.start[user] == self._plan.end(index))

    def _sorted(self, named: Mapping[int, float]) -> tuple[Part, ...]:
        kinds: dict[str, dict[int, float]] = {}
        for index, delay in named.items():
            if self._library[index].kind in DERATED:
                kinds.setdefault(self._library[index].kind, {})[index] = delay
        found = [
            Part(
                kind=kind,
                name=self._plan.typed.graph.origins[most].strip(),
                delay_ns=round(sum(those.values()), 3),
            )
            for kind, those in kinds.items()
            for most in [max(those, key=lambda k: (those[k], -k))]
        ]
        return tuple(sorted(found, key=lambda part: (-part.delay_ns, part.kind)))

    def _chooses(self, begin: str, end: str) -> bool:
        """Whether a path ends where the operands of a shared operator are taken.

        A multiplier block that took these registers over is entered from outside of its operator.
        """
        unit = _unit_of(end, self._units)
        if unit is None:
            return False
        entered = end.startswith(f"{unit}.core.") and not begin.startswith(f"{unit}.")
        return entered or _TAKEN.match(end[len(unit) + 1 :]) is not None

    def _inside(self, name: str) -> int | None:
        """The operation inside whose operator a name lies."""
        unit = _unit_of(name, self._units)
        if unit is not None and name.startswith(f"{unit}.core."):
            return self._units[unit].operations[0]
        for core in _CORES:
            before, found, _ = name.partition(core)
            if found and before in self._index:
                return self._index[before]
        return None

    def _leading_to(self, begin: str, end: str, named: Mapping[int, float]) -> tuple[int, ...]:
        """The operations of the cycle that ends in a register or a memory, by its name.

        A multiplier block that took the register over has another; then the register of the path's
        beginning says what was computed from it.
        """
        stored = [*self._stored_in(end)] or ([*self._computed_from(begin)] if "_MULT18X18D" in end else [])
        candidates = [index for index in stored if index not in named]
        if not candidates:
            return ()
        chains = [self._chain(index) for index in candidates]
        return max(chains, key=lambda chain: sum(map(self._last, chain)))

    def _stored_in(self, end: str) -> Iterable[int]:
        unit = _unit_of(end, self._units)
        if unit is not None and (found := re.match(r"_operand_(\d+)_file_(\d+)", end[len(unit) :])):
            port = self._choices[unit][int(found[1])]
            return [value for value, _ in port.files[int(found[2])].kept]
        if end.startswith("context_"):
            return self._roots(end)
        if end.startswith("results"):
            last = max((self._plan.end(k) for _, k in self._plan.typed.graph.outputs), default=0)
            return [k for _, k in self._plan.typed.graph.outputs if self._plan.end(k) == last]
        index = self._longest(end)
        if index is None:
            return ()
        cycle = re.match(r"_c(\d+)(?!\d)", end[len(self._names[index]) :])
        first = self._plan.end(index) + 1
        return [index] if cycle is None or int(cycle[1]) == first else ()

    def _computed_from(self, begin: str) -> Iterable[int]:
        """What leads on, without registers, from a value in the cycle in which its register stands."""
        index = self._longest(begin)
        if index is None:
            return
        found = re.match(r"_c(\d+)(?!\d)", begin[len(self._names[index]) :])
        cycle = int(found[1]) if found else self._plan.start[index]
        reached = {index}
        for k, reads in enumerate(map(operands, self._plan.typed.graph.operations)):
            at_once = self._plan.start[k] == self._plan.end(k) == cycle
            if at_once and not reached.isdisjoint(reads):
                reached.add(k)
                yield k

    def _roots(self, end: str) -> list[int]:
        """The values that a bank of the context stores; in registers that of the state that is named."""
        for bank in banks(self._plan):
            if end.startswith(f"{bank.name}."):
                field = re.split(r"_TRELLIS|\[|\$", end[len(bank.name) + 1 :])[0]
                pairs = dict(zip(bank.fields, bank.writes, strict=True))
                return [pairs[field]] if field in pairs else list(bank.writes)
        if _WRITE.match(end):
            return []
        roots = {identifier(name): root for name, root in self._plan.typed.graph.states}
        word = end.removeprefix("context_write_")
        return [root for name, root in roots.items() if word.startswith(name)][-1:]

    @cached_property
    def _choices(self) -> dict[str, tuple[Port, ...]]:
        return {name: ports(self._plan, unit) for name, unit in self._units.items()}

    def _longest(self, name: str) -> int | None:
        """The operation with whose name another name begins."""
        while name:
            if name in self._index:
                return self._index[name]
            name = name.rpartition("_")[0] if "_" in name else ""
        return None

    def _chain(self, index: int) -> tuple[int, ...]:
        """The longest way through operations without registers to the end of one, by the schedule."""
        chain = [index]
        while not self._plan.registers[chain[-1]]:
            before = [
                k
                for k in operands(self._plan.typed.graph.operations[chain[-1]])
                if self._plan.end(k) == self._plan.start[chain[-1]] and not self._still(k)
            ]
            if not before:
                break
            chain.append(max(before, key=lambda k: (self._arrival[k], -k)))
        return tuple(chain)

    def _still(self, index: int) -> bool:
        return isinstance(self._plan.typed.graph.operations[index], Constant)

    @cached_property
    def _arrival(self) -> list[int]:
        """Picoseconds into its last cycle at which each value is there."""
        found: list[int] = []
        for index, operation in enumerate(self._plan.typed.graph.operations):
            before = [
                found[k]
                for k in operands(operation)
                if self._plan.end(k) == self._plan.start[index] and not self._still(k)
            ]
            chained = 0 if self._plan.registers[index] else max(before, default=0)
            found.append(chained + self._last(index))
        return found

    def _last(self, index: int) -> int:
        return self._library[index].derated(self._plan.registers[index])[-1]


def _within(name: str) -> str:
    """A name of the flattened core as it reads inside the lane and the datapath."""
    name = re.sub(r"^lane_\d+\.", "", name)
    return name.removeprefix("datapath.")


def _unit_of(name: str, units: Mapping[str, object]) -> str | None:
    found = re.match(r"[a-z_]+_\d+(?=[._])", name)
    return found[0] if found and found[0] in units else None
