"""Quotients and reciprocals of ``arithmetic.division``, written as C over ``Value``.

The C divides in double where dividend and divisor are shorter than 53 bits: the rounded quotient of
two such integers never reaches an integer that the exact quotient does not, so its floor is exact.
"""

from itertools import pairwise

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton, reciprocal_table
from kalmanhdl.arithmetic.fixed import Fixed, Rounding, outside, rounded, saturated
from kalmanhdl.simulate.expression import Flag, Kind, Value, choose

_DOUBLE_BITS = 52


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
    quotient, sticky = _floor_quotient(numerator, denominator, form, _decides(mode))
    result, out = _clamped(rounded((quotient << 1) + sticky, 2, mode), form)
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
    result, out = _clamped(rounded(aligned, dropped, mode), form)
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


def _clamped(value: Value, form: Fixed) -> tuple[Value, Flag]:
    return saturated(value, form, choose).known(form.lowest, form.highest), outside(value, form)


def _floor_quotient(numerator: Value, denominator: Value, form: Fixed, sticky: bool) -> tuple[Value, Value]:
    """The floor of the quotient, and 1 if it is not exact.

    A quotient far outside of the format may come back as another one far outside.
    """
    writer = numerator.writer
    corners = [n // d for n in (numerator.low, numerator.high) for d in (denominator.low, denominator.high)]
    low, high = min(corners), max(corners)
    widest = max(map(abs, (numerator.low, numerator.high, denominator.high)))
    kind = max(numerator.kind, denominator.kind)
    if widest < 1 << _DOUBLE_BITS and kind <= Kind.INT64:
        low, high = max(low, 2 * form.lowest - 4), min(high, 2 * form.highest + 4)
        if low > high:
            low = high = low if low > 2 * form.highest else high
        return _double_quotient(numerator, denominator, low, high, sticky)
    if kind is Kind.WIDE:
        writer.widest = max(writer.widest, numerator.high.bit_length() + 2, denominator.high.bit_length() + 2)
        quotient = writer.value(f"wide_divide({numerator.at(kind)}, {denominator.at(kind)})", kind, low, high)
    else:
        name = f"floor_divide_{kind.value}"
        quotient = writer.value(f"{name}({numerator.at(kind)}, {denominator.at(kind)})", kind, low, high)
    if not sticky:
        return quotient, writer.literal(0)
    return quotient, (quotient * denominator != numerator).number


def _double_quotient(n: Value, d: Value, low: int, high: int, sticky: bool) -> tuple[Value, Value]:
    writer = n.writer
    exact = f"(double){n.at(n.kind)} / (double){d.at(d.kind)}"
    clamped = writer.bind("double", f"clamp({exact}, {float(low)!r}, {float(high)!r})")
    floor = clamped if low >= 0 else f"__builtin_floor({clamped})"
    to = writer.kind(low, high)
    quotient = writer.value(f"({to.c_type}){floor}", to, low, high)
    if not sticky:
        return quotient, writer.literal(0)
    # The remainder is less than the divisor: its last bits tell whether it is zero.
    unsigned = "uint32_t" if d.high < 1 << 32 else "uint64_t"
    q, a, b = (f"({unsigned}){v.at(v.kind)}" for v in (quotient, d, n))
    return quotient, writer.flag(f"{q} * {a} != {b}").number


def _missing_bits(divisor: Value, length: int) -> str:
    """The zeros above the leading one of a positive divisor, in ``length`` bits."""
    kind = divisor.kind
    text = divisor.at(kind)
    if kind is Kind.WIDE:
        return divisor.writer.bind("int64_t", f"{length} - wide_length({text})")
    counted = "int32_t" if kind is Kind.INT32 else "int64_t"
    return divisor.writer.bind(counted, f"{length} - bit_length_{kind.value}({text})")


def _shifted(value: Value, count: str, length: int) -> Value:
    """A positive value shifted left by a variable count, to at most ``length`` bits."""
    writer, high = value.writer, (1 << length) - 1
    kind = writer.kind(0, high)
    text = value.at(kind)
    shifted = f"wide_left({text}, {count})" if kind is Kind.WIDE else f"({kind.c_type})({text} << {count})"
    return writer.value(shifted, kind, value.low, high)


def _table_newton(normalised: Value, length: int, method: TableNewton, form: Fixed) -> Value:
    """2**length / divisor as ``arithmetic.division.table_newton``, of a divisor of full length."""
    writer, k = normalised.writer, method.index_bits
    normalised = normalised.known(1 << (length - 1), (1 << length) - 1)
    table = reciprocal_table(k)
    index = rounded(normalised, length - 1 - k, Rounding.FLOOR) & ((1 << k) - 1)
    entry = f"reciprocal_table_{k}[{index.at(min(index.kind, Kind.INT64))}]"
    kind = Kind.INT32 if max(table) < 1 << 31 else Kind.INT64
    value = writer.value(entry, kind, min(table), max(table))
    for fraction, target in pairwise(method.fractions(form)):
        exact = (1 << (length + fraction + 1)) - normalised * value
        kept = target + 2
        factor = rounded(exact, length + fraction - kept, Rounding.FLOOR)
        value = (value * factor) >> (fraction + kept - target)
    return value
