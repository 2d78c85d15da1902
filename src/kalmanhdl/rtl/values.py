"""The values of all operations of a plan in integers, each built in its cycle from what it reads."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import assert_never

from amaranth.hdl import Const, Module, Value

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, rounded
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Coefficient,
    Constant,
    Divide,
    Flag,
    Input,
    Multiply,
    Negative,
    Not,
    NotFinite,
    Operation,
    Or,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    StateFlag,
    Subtract,
    SumOfProducts,
    SumOutside,
    Table,
    Unary,
)
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl import exact
from kalmanhdl.rtl.bus import Bus
from kalmanhdl.rtl.exact import Number
from kalmanhdl.rtl.layouts import shape
from kalmanhdl.rtl.names import operation_names
from kalmanhdl.rtl.operators import divider, multiplier
from kalmanhdl.rtl.quantiser import aligned, quantised
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.shared_unit import SharedUnit
from kalmanhdl.rtl.stages import named
from kalmanhdl.rtl.table import looked_up
from kalmanhdl.rtl.timeline import Always, Phases, Timeline
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.results import Cut, FromUnit, Moved, OnBus, Own, Rounded, Wire, source
from kalmanhdl.schedule.storage import standing, wires


class Values:
    """The hardware of a plan's operations.

    ``inputs`` gives the inputs and flags of a step by name, as they stand in cycle 0; ``states`` each
    state as it stands in the cycle in which its operation starts; ``units`` the shared operators.
    """

    def __init__(
        self,
        m: Module,
        phases: Phases,
        plan: Plan,
        inputs: Mapping[str, Value],
        states: Mapping[str, Value],
        units: Sequence[SharedUnit],
    ) -> None:
        self._m = m
        self._phases = phases
        self.plan = plan
        self.wires = wires(plan)
        self._inputs = inputs
        self._states = states
        self._units = units
        self._buses = [Bus(plan, self.wires, units, number) for number in range(len(plan.buses))]
        self._standing = standing(plan)
        self._wired: dict[Wire, Value] = {}
        self._names = operation_names(plan.typed.graph)
        self._roundings: dict[tuple[int, int, Rounding, int], Value] = {}
        self._timelines: list[Timeline | Always] = []
        for index, operation in enumerate(plan.typed.graph.operations):
            self._timelines.append(self._timeline(index, operation))
        for bus in self._buses:
            bus.drive(m, phases, self.at)

    def at(self, index: int, cycle: int) -> Value:
        """The value of an operation as it stands in a cycle, its end or later."""
        return self._timelines[index].at(cycle)

    def result(self, index: int) -> Value:
        """The value of an operation in the cycle of its end, on the wire that others may share."""
        wire = self.wires.of(index)
        return self.at(index, self.plan.end(index)) if isinstance(wire, Own) else self._on(wire)

    def _on(self, wire: Wire) -> Value:
        """The hardware behind a wire that several operations share."""
        carrier = source(wire) if isinstance(wire, OnBus) else wire
        if carrier not in self._wired:
            self._wired[carrier] = self._behind(carrier)
        return self._wired[carrier]

    def _behind(self, wire: Wire) -> Value:
        match wire:
            case FromUnit(unit):
                return self._units[unit].result
            case OnBus(bus):
                return self._buses[bus].carried
            case Moved(before):
                return self._on(before)
            case Cut(before, form):
                if form is None:
                    return exact.negative(Number(self._on(before), self._form_on(before)))
                low = aligned(self._on(before), self._form_on(before).fraction, form, Rounding.FLOOR)
                return fitted(low, form.width, form.signed)
            case Rounded(before, form, rounding, overflow, outside):
                fraction = self._form_on(before).fraction
                both = quantised(self._on(before), fraction, form, rounding, overflow)
                value = both[outside]
                name = f"shared_{'outside' if outside else 'rounded'}_{len(self._wired)}"
                return named(self._m, name, value)
            case Own():
                raise AssertionError(wire)
            case _:
                assert_never(wire)

    def _form_on(self, wire: Wire) -> Fixed:
        match wire:
            case FromUnit(unit, fraction):
                form = self._units[unit].form
                return Fixed(width=form.width, fraction=fraction, signed=form.signed)
            case OnBus(bus, fraction):
                form = self._buses[bus].form
                return Fixed(width=form.width, fraction=fraction, signed=form.signed)
            case Moved(before, exponent):
                form = self._form_on(before)
                return Fixed(width=form.width, fraction=form.fraction - exponent, signed=form.signed)
            case Cut(_, form) | Rounded(_, form):
                assert form is not None
                return form
            case Own():
                raise AssertionError(wire)
            case _:
                assert_never(wire)

    def _timeline(self, index: int, operation: Operation) -> Timeline | Always:
        start, name = self.plan.start[index], self._names[index]
        wire = self.wires.of(index)
        if not isinstance(wire, Own):
            return self._named(index, self._on(wire), self.plan.end(index))
        match operation:
            case Constant(value):
                form = self._form(index)
                return Always(Const(int(value / form.resolution), shape(form)))
            case Coefficient(signal):
                return Always(self._inputs[signal])
            case Input(signal) | Flag(signal):
                last = self._standing[index]
                return Timeline(self._m, self._phases, name, self._inputs[signal], 0, last=last)
            case State(signal) | StateFlag(signal):
                last = self._standing[index]
                return Timeline(self._m, self._phases, name, self._states[signal], start, last=last)
            case Bits(a, form):
                low = aligned(self.at(a, start), self._fraction(a), form, Rounding.FLOOR)
                return self._named(index, fitted(low, form.width, form.signed), start)
            case Table(a, rows):
                return self._named(index, self._row(index, a, rows), start)
            case Multiply():
                return self._named(index, self._product(index, operation), self.plan.end(index))
            case Unary() | Binary() | NotFinite():
                raise AssertionError(f"{operation} in a graph of integers")
            case SumOfProducts():
                raise AssertionError(f"{operation} on no unit")
            case SumOutside(a):
                flag = self._units[self.wires.unit[a]].outside
                return self._named(index, flag, self.plan.end(a))
            case Divide() | Reciprocal():
                return self._named(index, self._quotient(index, operation), self.plan.end(index))
            case _:
                # Registers of these operations, if any, follow the logic: the timeline makes them.
                return self._named(index, self._logic(index, operation), start)

    def _logic(
        self,
        index: int,
        operation: Add | Subtract | Shift | Select | Quantise | Outside | Negative | And | Or | Not,
    ) -> Value:
        start = self.plan.start[index]
        match operation:
            case Add(a, b):
                return exact.add(self._number(a, start), self._number(b, start), self._fraction(index))
            case Subtract(a, b):
                return exact.subtract(self._number(a, start), self._number(b, start), self._fraction(index))
            case Shift(a):
                return self.at(a, start)
            case Select(flag, a, b):
                chosen = self.at(flag, start)
                return exact.select(
                    chosen, self._number(a, start), self._number(b, start), self._fraction(index)
                )
            case Quantise(a, form, rounding, overflow):
                return self._quantised(index, a, form, rounding, overflow)[0]
            case Outside(a, form, rounding):
                return self._quantised(index, a, form, rounding, Overflow.WRAP)[1]
            case Negative(a):
                return exact.negative(self._number(a, start))
            case And(a, b):
                return self.at(a, start) & self.at(b, start)
            case Or(a, b):
                return self.at(a, start) | self.at(b, start)
            case Not(a):
                return ~self.at(a, start)
            case _:
                assert_never(operation)

    def _quantised(
        self, index: int, a: int, form: Fixed, rounding: Rounding, overflow: Overflow
    ) -> tuple[Value, Value]:
        """Quantise with the rounding shared by all operations that round the same operand alike."""
        start, fraction = self.plan.start[index], self._fraction(a)
        key = a, form.fraction, rounding, start
        if key not in self._roundings:
            value = aligned(self.at(a, start), fraction, form, rounding)
            name = f"{self._names[index]}_rounded"
            self._roundings[key] = named(self._m, f"{name}_c{start}", value)
        assert isinstance(self.plan.typed, TypedGraph)
        interval = self.plan.typed.intervals[a]
        assert interval is not None
        low, high = (
            rounded(raw, fraction - form.fraction, rounding) for raw in (interval.low, interval.high)
        )
        return quantised(self._roundings[key], form.fraction, form, rounding, overflow, low, high)

    def _row(self, index: int, a: int, rows: tuple[Fraction, ...]) -> Value:
        form, address = self._form(index), (len(rows) - 1).bit_length()
        mask = (1 << form.width) - 1
        entries = [int(row / form.resolution) & mask for row in rows]
        number = fitted(self.at(a, self.plan.start[index]), address, False)
        return looked_up(self._m, f"{self._names[index]}_row", number, entries, form.width)

    def _product(self, index: int, operation: Multiply) -> Value:
        start = self.plan.start[index]
        a, b = self.at(operation.a, start), self.at(operation.b, start)
        core = multiplier(self.plan, index, a.shape(), b.shape())
        self._m.submodules[f"{self._names[index]}_multiplier"] = core
        self._m.d.comb += [core.a.eq(a), core.b.eq(b)]
        return core.product

    def _quotient(self, index: int, operation: Divide | Reciprocal) -> Value:
        start = self.plan.start[index]
        core = divider(self.plan, index)
        self._m.submodules[f"{self._names[index]}_divider"] = core
        match operation:
            case Divide(a, b):
                self._m.d.comb += [core.dividend.eq(self.at(a, start)), core.divisor.eq(self.at(b, start))]
            case Reciprocal(a):
                self._m.d.comb += core.divisor.eq(self.at(a, start))
        return core.quotient

    def _named(self, index: int, value: Value, cycle: int) -> Timeline:
        form = self.plan.typed.formats[index]
        return Timeline.computed(self._m, self._phases, self._names[index], value, shape(form), cycle)

    def _number(self, index: int, cycle: int) -> Number:
        return Number(self.at(index, cycle), self._form(index))

    def _fraction(self, index: int) -> int:
        return self._form(index).fraction

    def _form(self, index: int) -> Fixed:
        form = self.plan.typed.formats[index]
        assert isinstance(form, Fixed)
        return form
