"""The values of all operations of a plan in floating point."""

from collections.abc import Mapping, Sequence

from amaranth.hdl import Cat, Const, Module, Mux, Value, unsigned

from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import (
    Add,
    Constant,
    Divide,
    Input,
    Multiply,
    Negative,
    NotFinite,
    Operation,
    Reciprocal,
    Select,
    Shift,
    Subtract,
    Table,
    Unary,
    operands,
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.rtl.float_operators import core
from kalmanhdl.rtl.floating.encoding import canonical, decoded
from kalmanhdl.rtl.shared_unit import SharedUnit
from kalmanhdl.rtl.timeline import Always, Phases, Timeline
from kalmanhdl.rtl.values import Values
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.results import Own


class FloatValues(Values):
    """As ``Values``, of a plan whose graph is a ``FloatGraph``.

    The value of a fused product is its two factors, side by side, for the sum that takes it.
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
        assert isinstance(plan.typed, FloatGraph)
        self._graph = plan.typed
        super().__init__(m, phases, plan, inputs, states, units)

    def _timeline(self, index: int, operation: Operation) -> Timeline | Always:
        form, start = self._graph.form, self.plan.start[index]
        wire = self.wires.of(index)
        if not isinstance(wire, Own):
            return self._named(index, self._on(wire), self.plan.end(index))
        match operation:
            case Constant(value):
                return Always(Const(form.nearest(value), form.width))
            case Input(signal):
                return self._named(index, canonical(self._m, signal, form, self._inputs[signal]), start)
            case Multiply(a, b) if index in self._graph.fused:
                pair = Cat(self.at(a, start), self.at(b, start))
                shape = unsigned(2 * form.width)
                return Timeline.computed(self._m, self._phases, self._names[index], pair, shape, start)
            case Add() | Subtract() | Multiply() | Divide() | Reciprocal() | Shift() | Unary() | Table():
                return self._named(index, self._result(index, operation), self.plan.end(index))
            case Select(flag, a, b):
                value = Mux(self.at(flag, start), self.at(a, start), self.at(b, start))
                return self._named(index, value, start)
            case NotFinite(a):
                exponent = self.at(a, start)[form.mantissa : -1]
                return self._named(index, exponent.all(), start)
            case Negative(a):
                return self._named(index, self._negative(index, form, self.at(a, start)), start)
            case _:
                return super()._timeline(index, operation)

    def _result(self, index: int, operation: Operation) -> Value:
        """The result of a core that is fed with the operands, by the names of its ports."""
        start = self.plan.start[index]
        unit = core(self.plan, index, self.plan.registers[index])
        self._m.submodules[f"{self._names[index]}_core"] = unit
        fused = self._graph.fused_sum(index)
        if fused is None:
            given = [self.at(k, start) for k in operands(operation)]
        else:
            pair, width = self.at(fused.product, start), self._graph.form.width
            given = [pair[:width], pair[width:], self.at(fused.addend, start)]
        ports = [name for name in ("a", "b", "c") if hasattr(unit, name)]
        self._m.d.comb += [getattr(unit, p).eq(v) for p, v in zip(ports, given, strict=True)]
        result: Value = unit.result
        return result

    def _negative(self, index: int, form: Float, raw: Value) -> Value:
        parts = decoded(self._m, f"{self._names[index]}_of", form, raw)
        return parts.sign & ~parts.zero & ~parts.nan
