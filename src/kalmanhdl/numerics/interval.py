"""Exact interval analysis: the format and the raw integers of each operation, from its operands."""

from fractions import Fraction
from typing import assert_never

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton, divide, reciprocal
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, rounded
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Bits,
    Constant,
    Divide,
    Input,
    Multiply,
    Number,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    Subtract,
    SumOfProducts,
    Table,
    Unary,
)
from kalmanhdl.numerics.typed import Interval

Typed = tuple[Fixed, Interval]


def type_of(operation: Number, types: list[Typed | None], given: Fixed | None) -> Typed:
    """The exact format and interval of an operation on operands of known types.

    ``given`` is the format of an input, a state or a division, whose values it bounds.
    """
    match operation:
        case Input() | State():
            assert given is not None
            return given, of_format(given)
        case Constant(value):
            return constant_type(value)
        case Add(a, b):
            fraction, x, y = _common(_known(types[a]), _known(types[b]))
            return _exact(x.low + y.low, x.high + y.high, fraction)
        case Subtract(a, b):
            fraction, x, y = _common(_known(types[a]), _known(types[b]))
            return _exact(x.low - y.high, x.high - y.low, fraction)
        case Multiply(a, b):
            return _product(_known(types[a]), _known(types[b]))
        case Shift(a, exponent):
            form, interval = _known(types[a])
            return Fixed(width=form.width, fraction=form.fraction - exponent, signed=form.signed), interval
        case Select(_, a, b):
            fraction, x, y = _common(_known(types[a]), _known(types[b]))
            return _exact(min(x.low, y.low), max(x.high, y.high), fraction)
        case Quantise(a, form, rounding, overflow):
            operand, interval = _known(types[a])
            return form, quantised(interval, operand.fraction, form, rounding, overflow)
        case SumOfProducts(_, form):
            return form, of_format(form)
        case Bits(a, form):
            operand, interval = _known(types[a])
            return form, quantised(interval, operand.fraction, form, Rounding.FLOOR, Overflow.WRAP)
        case Table(a, rows):
            return _rows_type(_known(types[a]), rows)
        case Divide() | Reciprocal():
            assert given is not None
            return given, of_format(given)
        case Unary() | Binary():
            raise AssertionError(f"{operation} in a graph of integers")
        case _:
            assert_never(operation)


def constant_type(value: Fraction) -> Typed:
    """The narrowest format of a constant; trailing zeros are left to the binary point."""
    fraction = value.denominator.bit_length() - 1
    raw = value.numerator
    if raw:
        trailing = (raw & -raw).bit_length() - 1
        raw, fraction = raw >> trailing, fraction - trailing
    return _exact(raw, raw, fraction)


def _rows_type(index: Typed, rows: tuple[Fraction, ...]) -> Typed:
    form, interval = index
    assert form.fraction == 0, f"{form} is no number of a row"
    assert 0 <= interval.low <= interval.high < len(rows), f"rows {interval} of {len(rows)}"
    fraction = max(row.denominator for row in rows).bit_length() - 1
    return _exact(int(min(rows) * (1 << fraction)), int(max(rows) * (1 << fraction)), fraction)


def reciprocal_interval(divisor: Typed, form: Fixed, rounding: Rounding, method: DivisionMethod) -> Interval:
    """The reciprocals of a divisor's interval. Newton steps may leave the exact ones by a little."""
    divisor_form, interval = divisor
    ends = max(interval.high, 1), max(interval.low, 0)
    if isinstance(method, TableNewton) and method.iterations:
        lowest, highest = (divide(1, 0, end, divisor_form.fraction, form, rounding)[0] for end in ends)
        slack = (highest >> method.index_bits) + 1
        return Interval(low=max(lowest - slack, 0), high=min(highest + slack, form.highest))
    # Neither exact quotients nor the entries of a table rise with the divisor.
    low, high = (reciprocal(end, divisor_form.fraction, form, rounding, method)[0] for end in ends)
    return Interval(low=low, high=high)


def least_divisor(divisor: Fixed, form: Fixed, method: DivisionMethod) -> int:
    """The least raw divisor whose reciprocal fits its format; the method may err upwards."""
    limit = form.real(form.highest)
    if not isinstance(method, LongDivision):
        limit *= 1 - Fraction(1, 1 << method.index_bits)
    exact = 1 / limit / divisor.resolution
    return max(1, -(-exact.numerator // exact.denominator))


def _known(typed: Typed | None) -> Typed:
    assert typed is not None, "an operand is a flag"
    return typed


def _exact(low: int, high: int, fraction: int) -> Typed:
    return smallest(low, high, fraction), Interval(low=low, high=high)


def _product(a: Typed, b: Typed) -> Typed:
    (p, x), (q, y) = a, b
    corners = [i * j for i in (x.low, x.high) for j in (y.low, y.high)]
    return _exact(min(corners), max(corners), p.fraction + q.fraction)


def _common(a: Typed, b: Typed) -> tuple[int, Interval, Interval]:
    (p, x), (q, y) = a, b
    fraction = max(p.fraction, q.fraction)
    return fraction, aligned(x, p, fraction), aligned(y, q, fraction)


def smallest(low: int, high: int, fraction: int) -> Fixed:
    """The narrowest format that holds every raw integer of an interval."""
    signed = low < 0
    width = max(high.bit_length(), (~low).bit_length() if signed else 0) + signed
    return Fixed(width=max(width, 1), fraction=fraction, signed=signed)


def of_format(form: Fixed) -> Interval:
    """Every raw integer of a format."""
    return Interval(low=form.lowest, high=form.highest)


def aligned(interval: Interval, form: Fixed, fraction: int) -> Interval:
    """The interval with its raw integers at a finer fraction."""
    shift = fraction - form.fraction
    return Interval(low=interval.low << shift, high=interval.high << shift)


def quantised(
    interval: Interval, fraction: int, form: Fixed, rounding: Rounding, overflow: Overflow
) -> Interval:
    """The interval after rounding (which is monotone) and overflow."""
    low = rounded(interval.low, fraction - form.fraction, rounding)
    high = rounded(interval.high, fraction - form.fraction, rounding)
    if overflow is Overflow.WRAP and not (form.lowest <= low and high <= form.highest):
        return of_format(form)
    return Interval(
        low=min(max(low, form.lowest), form.highest), high=min(max(high, form.lowest), form.highest)
    )
