"""Quotients and reciprocals of ``arithmetic.division``, written as C over ``Value``.

The C divides in double where dividend and divisor are shorter than 52 bits: the rounded quotient of
two such integers never reaches an integer that the exact quotient does not, so its floor is exact.
"""

from itertools import pairwise

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton, reciprocal_table
from kalmanhdl.arithmetic.fixed import Fixed, Rounding, rounded
from kalmanhdl.simulate.expression import Flag, Kind, Value, choose

_DOUBLE_BITS = 51


def divide(
    dividend: Value,
    dividend_fraction: int,
    divisor: Value,
    divisor_fraction: int,
    form: Fixed,
    mode: Rounding,
) -> tuple[Value, Flag]:
    """The quotient as ``arithmetic.division.divide`` defines it, and whether it did not fit."""
    zero, divisor = _positive(divisor)
    exponent = divisor_fraction - dividend_fraction + form.fraction + 1
    numerator, denominator = dividend << max(exponent, 0), divisor << max(-exponent, 0)
    quotient, sticky = _floor_quotient(numerator, denominator, _decides(mode))
    result, out = rounded((quotient << 1) + sticky, 2, mode).limited(form.lowest, form.highest)
    limit = choose(dividend < 0, form.lowest, form.highest)
    return choose(zero, limit, result), zero | out


def reciprocal(
    divisor: Value, divisor_fraction: int, form: Fixed, mode: Rounding, method: DivisionMethod
) -> tuple[Value, Flag]:
    """The reciprocal as ``arithmetic.division.reciprocal`` defines it, and whether it did not fit."""
    if isinstance(method, LongDivision):
        return divide(divisor.lift(1), 0, divisor, divisor_fraction, form, mode)
    zero, divisor = _positive(divisor)
    # All shifts by the length of the divisor become one shift to the top; the rest are constant.
    length = max(divisor.high.bit_length(), 1)
    missing = _missing_bits(divisor, length)
    approximation = _table_newton(_shifted(divisor, missing, length), length, method, form)
    aligned = _shifted(approximation, missing, approximation.high.bit_length() + length - 1)
    dropped = method.fractions(form)[-1] + length - divisor_fraction - form.fraction
    result, out = rounded(aligned, dropped, mode).limited(form.lowest, form.highest)
    return choose(zero, form.highest, result), zero | out


def _positive(divisor: Value) -> tuple[Flag, Value]:
    """Whether a divisor is zero (or below, which counts as zero), and it or else one."""
    zero = divisor < 1
    if zero.known:
        return zero, divisor.lift(1)
    return zero, choose(zero, 1, divisor).known(1, max(divisor.high, 1))


def _decides(mode: Rounding) -> bool:
    """Whether a sticky bit below half a unit can change the rounded value."""
    return any(rounded(2 * bits, 2, mode) != rounded(2 * bits + 1, 2, mode) for bits in range(-4, 4))


def _floor_quotient(numerator: Value, denominator: Value, sticky: bool) -> tuple[Value, Value]:
    """The floor of the quotient, and 1 if it is not exact."""
    writer = numerator.writer
    corners = [n // d for n in (numerator.low, numerator.high) for d in (denominator.low, denominator.high)]
    low, high = min(corners), max(corners)
    widest = max(map(abs, (numerator.low, numerator.high, denominator.high)))
    kind = max(numerator.kind, denominator.kind)
    if widest < 1 << _DOUBLE_BITS and kind <= Kind.INT64:
        return _double_quotient(numerator, denominator, low, high, sticky)
    kind = max(kind, Kind.INT64)
    if kind is Kind.WIDE:
        writer.widest = max(writer.widest, numerator.high.bit_length() + 2, denominator.high.bit_length() + 2)
    text = f"divide_{kind.c_type}({numerator.at(kind)}, {denominator.forced(1, denominator.high).at(kind)})"
    quotient = writer.value(text, kind, low, high)
    if not sticky:
        return quotient, writer.literal(0)
    return quotient, (quotient * denominator != numerator).number


def _double_quotient(n: Value, d: Value, low: int, high: int, sticky: bool) -> tuple[Value, Value]:
    writer, kind = n.writer, Kind.INT64
    a, b = n.at(kind), d.at(kind)
    quotient = writer.value(f"divide_short({a}, {b})", kind, low, high)
    if not sticky:
        return quotient, writer.literal(0)
    # The remainder is less than the divisor: a product that wraps still tells whether it is zero.
    product = writer.bind(kind.c_type, f"multiply_i64({quotient.at(kind)}, {b})")
    return quotient, writer.flag(f"~equal_i64({product}, {a})").number


def _missing_bits(divisor: Value, length: int) -> Value:
    """The zeros above the leading one of a positive divisor, in ``length`` bits."""
    text = f"length_{divisor.kind.c_type}({divisor.at(divisor.kind)})"
    return (length - divisor.writer.value(text, Kind.INT32, 1, length)).forced(0, length - 1)


def _shifted(value: Value, count: Value, length: int) -> Value:
    """A positive value shifted left by a variable count, to at most ``length`` bits."""
    writer, high = value.writer, (1 << length) - 1
    kind = writer.kind(0, high)
    shifted = f"shift_{kind.c_type}({value.at(kind)}, {count.at(Kind.INT32)})"
    return writer.value(shifted, kind, value.low, high)


def _table_newton(normalised: Value, length: int, method: TableNewton, form: Fixed) -> Value:
    """2**length / divisor as ``arithmetic.division.table_newton``, of a divisor of full length."""
    writer, k = normalised.writer, method.index_bits
    normalised = normalised.known(1 << (length - 1), (1 << length) - 1)
    table = reciprocal_table(k)
    index = rounded(normalised, length - 1 - k, Rounding.FLOOR) & ((1 << k) - 1)
    entry = f"look_up(reciprocal_table_{k}, {index.at(Kind.INT32)})"
    value = writer.value(entry, Kind.INT32, min(table), max(table))
    for fraction, target in pairwise(method.fractions(form)):
        exact = (1 << (length + fraction + 1)) - normalised * value
        kept = target + 2
        factor = rounded(exact, length + fraction - kept, Rounding.FLOOR)
        value = (value * factor) >> (fraction + kept - target)
    return value
