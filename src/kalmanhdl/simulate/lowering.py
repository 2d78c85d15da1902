"""Every operation of a typed graph as a C value or flag.

Bounds are derived here from the formats of inputs, states and rounded results alone, so that the C is
exact even for a value that a range analysis believed impossible.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, rounded, wrapped
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Constant,
    Divide,
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
from kalmanhdl.graph.operations import Flag as FlagInput
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.simulate import quotients
from kalmanhdl.simulate.expression import Flag, Value, Writer, choose, row_of

Signal = Value | Flag


@dataclass(slots=True)
class Lowering:
    """The signals of a graph's operations in C, and which of them can leave their format.

    ``given`` are the flags of commands that are known when the C is written.
    """

    typed: TypedGraph
    writer: Writer
    given: Mapping[str, bool]
    signals: list[Signal]
    saturations: dict[int, Flag]

    def form(self, index: int) -> Fixed:
        """The format of a number."""
        form = self.typed.formats[index]
        assert form is not None
        return form

    def number(self, index: int) -> Value:
        """The signal of an operation that is a number."""
        signal = self.signals[index]
        assert isinstance(signal, Value)
        return signal

    def flag(self, index: int) -> Flag:
        """The signal of an operation that is a flag."""
        signal = self.signals[index]
        assert isinstance(signal, Flag)
        return signal

    def aligned(self, index: int, fraction: int) -> Value:
        """A number with its binary point moved down to ``fraction`` bits."""
        return self.number(index) << (fraction - self.form(index).fraction)


def lower(typed: TypedGraph, writer: Writer, given: Mapping[str, bool] | None = None) -> Lowering:
    """Write the C of all operations, in order, with some flags of commands given."""
    lowering = Lowering(typed, writer, given or {}, [], {})
    for index, operation in enumerate(typed.graph.operations):
        lowering.signals.append(_signal(lowering, index, operation))
    return lowering


def _signal(lowering: Lowering, index: int, operation: Operation) -> Signal:
    number, flag = lowering.number, lowering.flag

    def aligned(operand: int) -> Value:
        return lowering.aligned(operand, lowering.form(index).fraction)

    match operation:
        case Input() | State():
            return _loaded(lowering, index, "in" if isinstance(operation, Input) else "old")
        case FlagInput(name) if name in lowering.given:
            return Flag(lowering.writer, "", lowering.given[name])
        case FlagInput():
            return lowering.writer.flag(f"in->x{index}")
        case StateFlag():
            return lowering.writer.flag(f"old->x{index}")
        case Constant(value):
            return lowering.writer.literal(int(value / lowering.form(index).resolution))
        case Add(a, b):
            return aligned(a) + aligned(b)
        case Subtract(a, b):
            return aligned(a) - aligned(b)
        case Multiply(a, b):
            return number(a) * number(b)
        case Shift(a):
            return number(a)
        case Select(condition, a, b):
            return choose(flag(condition), aligned(a), aligned(b))
        case Quantise(a, form, rounding, overflow):
            raw = rounded(number(a), lowering.form(a).fraction - form.fraction, rounding)
            return _fitted(lowering, index, raw, form, overflow)
        case Bits(a, form):
            return _bits(rounded(number(a), lowering.form(a).fraction - form.fraction, Rounding.FLOOR), form)
        case Table(a, rows):
            return row_of([int(row / lowering.form(index).resolution) for row in rows], number(a))
        case Divide() | Reciprocal():
            return _quotient(lowering, index, operation)
        case Outside(a, form, rounding):
            raw = rounded(number(a), lowering.form(a).fraction - form.fraction, rounding)
            return _outside(raw, form)
        case Negative(a):
            return number(a) < 0
        case And(a, b):
            return flag(a) & flag(b)
        case Or(a, b):
            return flag(a) | flag(b)
        case Not(a):
            return flag(a).negated()
        case SumOfProducts() | SumOutside():
            raise AssertionError(f"{operation}: the engine follows the graph from before the schedule")
        case Unary() | Binary() | NotFinite():
            raise AssertionError(f"{operation} in a graph of integers")
        case _ as never:
            assert_never(never)


def _loaded(lowering: Lowering, index: int, place: str) -> Value:
    form = lowering.form(index)
    kind = lowering.writer.kind(form.lowest, form.highest)
    return lowering.writer.value(f"{place}->x{index}", kind, form.lowest, form.highest)


def _outside(raw: Value, form: Fixed) -> Flag:
    return raw.limited(form.lowest, form.highest)[1]


def _fitted(lowering: Lowering, index: int, raw: Value, form: Fixed, overflow: Overflow) -> Value:
    if form.lowest <= raw.low and raw.high <= form.highest:
        return raw
    clamped, lowering.saturations[index] = raw.limited(form.lowest, form.highest)
    is_wrapped = overflow is Overflow.WRAP and lowering.saturations[index].known is not False
    value = wrapped(raw, form) if is_wrapped else clamped
    assert isinstance(value, Value)
    return value


def _bits(raw: Value, form: Fixed) -> Value:
    if form.lowest <= raw.low and raw.high <= form.highest:
        return raw
    value = wrapped(raw, form)
    assert isinstance(value, Value)
    return value


def _quotient(lowering: Lowering, index: int, operation: Divide | Reciprocal) -> Value:
    form, rounding = lowering.form(index), lowering.typed.division_rounding
    if isinstance(operation, Reciprocal):
        divisor, fraction = lowering.number(operation.a), lowering.form(operation.a).fraction
        result = quotients.reciprocal(divisor, fraction, form, rounding, lowering.typed.division)
    else:
        a, b = operation.a, operation.b
        dividend, divisor = lowering.number(a), lowering.number(b)
        fractions = lowering.form(a).fraction, lowering.form(b).fraction
        result = quotients.divide(dividend, fractions[0], divisor, fractions[1], form, rounding)
    value, lowering.saturations[index] = result
    return value
