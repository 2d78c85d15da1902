"""Buses: what brings the sums of several operators, one in a cycle, to all that take them."""

from collections.abc import Callable, Sequence
from functools import cached_property

from amaranth.hdl import Const, Module, Mux, Signal, Value

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.operations import Constant, Select
from kalmanhdl.rtl.choice import chosen
from kalmanhdl.rtl.shapes import fitted, shape_of
from kalmanhdl.rtl.shared_unit import SharedUnit
from kalmanhdl.rtl.timeline import Phases
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.results import Wires


class Bus:
    """A bus of a plan by its number; ``form`` holds the raw integers of all that it carries."""

    def __init__(self, plan: Plan, wires: Wires, units: Sequence[SharedUnit], number: int) -> None:
        self._plan, self._wires, self._units = plan, wires, units
        self._number, self._sums = number, plan.buses[number]

    @cached_property
    def _choices(self) -> dict[int, int]:
        """The operations that choose between a sum of the bus and a constant, by the sum."""
        users = self._plan.typed.graph.users
        return {
            index: user for index in self._sums for user in users[index] if self._wires.guarded(user) == index
        }

    @cached_property
    def form(self) -> Fixed:
        """The format, without its binary point."""
        forms = {self._units[self._wires.unit[index]].form for index in self._sums}
        forms |= {form for user in self._choices.values() if isinstance(form := self._format(user), Fixed)}
        signed = any(form.signed for form in forms)
        width = max(form.width + (signed and not form.signed) for form in forms)
        return Fixed(width=width, fraction=0, signed=signed)

    @cached_property
    def carried(self) -> Signal:
        """The bus."""
        return Signal(shape_of(self.form), name=f"bus_{self._number}")

    def drive(self, m: Module, phases: Phases, at: Callable[[int, int], Value]) -> None:
        """Bring everything on the bus in its cycle. ``at`` gives a flag as it stands in a cycle."""
        drivers = list(dict.fromkeys(self._wires.unit[index] for index in self._sums))
        words = [0] * self._plan.interval
        for index in self._sums:
            words[self._phase(index)] = drivers.index(self._wires.unit[index])
        results = [self._fitted(self._units[unit].result) for unit in drivers]
        carried = self._one_of(m, phases, "source", words, results)
        m.d.comb += self.carried.eq(self._guarded(m, phases, at, carried) if self._choices else carried)

    def _guarded(self, m: Module, phases: Phases, at: Callable[[int, int], Value], carried: Value) -> Value:
        """The sum, or the constant that an operation chooses in its place."""
        operations, form = self._plan.typed.graph.operations, self.form
        conditions: dict[tuple[int, bool], Value] = {}
        words, constants = [0] * self._plan.interval, [0] * self._plan.interval
        holding: list[Value] = [Const(1, 1)]
        for index, user in self._choices.items():
            operation = operations[user]
            assert isinstance(operation, Select)
            holds = operation.a == index
            other = operations[operation.b if holds else operation.a]
            assert isinstance(other, Constant)
            flag = at(operation.flag, self._plan.start[user])
            condition = conditions.setdefault((id(flag), holds), flag if holds else ~flag)
            place = next((k for k, known in enumerate(holding) if known is condition), len(holding))
            holding += [condition] if place == len(holding) else []
            resolution = self._format(user).resolution
            words[self._phase(index)] = place
            constants[self._phase(index)] = int(other.value / resolution) & ((1 << form.width) - 1)
        holds_now = self._one_of(m, phases, "guard", words, holding)
        constant = self._fitted(phases.table(f"bus_{self._number}_constant", constants, form.width))
        return self._fitted(Mux(holds_now, carried, constant))

    def _one_of(
        self, m: Module, phases: Phases, name: str, words: list[int], sources: Sequence[Value]
    ) -> Value:
        name = f"bus_{self._number}_{name}"
        select = phases.table(name, words, (len(sources) - 1).bit_length())
        return chosen(m, name, select, sources, sources[-1].shape())

    def _phase(self, index: int) -> int:
        return self._plan.end(index) % self._plan.interval

    def _format(self, index: int) -> Fixed:
        form = self._plan.typed.formats[index]
        assert isinstance(form, Fixed)
        return form

    def _fitted(self, value: Value) -> Value:
        return fitted(value, self.form.width, self.form.signed)
