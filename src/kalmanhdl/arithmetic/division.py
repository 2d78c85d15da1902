"""The definition of quotients and reciprocals in integers.

Engine, Verilog and proofs are held to these functions. A divisor is an unsigned raw integer: the
divisors of a Kalman filter are variances. Every result saturates; a zero divisor gives the limit.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

from kalmanhdl.arithmetic.fixed import Fixed, Rounding, rounded


@dataclass(frozen=True, slots=True, kw_only=True)
class LongDivision:
    """Exact quotient, rounded once. Hardware: non-restoring rows of one (radix 2) or two bits (radix 4)."""

    radix: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class TableNewton:
    """Reciprocal from a table over the normalised divisor, refined by Newton steps.

    The divisor is shifted left until its leading one stands at the top. The ``index_bits`` bits after
    the leading one address the table; each iteration doubles the number of correct bits. No iteration
    leaves the table alone.
    """

    index_bits: int
    iterations: int

    @property
    def table_fraction(self) -> int:
        """Fraction bits of a table entry, a number between 1 and 2."""
        return self.index_bits + 2

    def fractions(self, form: Fixed) -> tuple[int, ...]:
        """Fraction bits of the approximation: of the table, then after each iteration."""
        fractions = [self.table_fraction]
        for _ in range(self.iterations):
            fractions.append(min(2 * fractions[-1], max(form.width + 2, self.table_fraction)))
        return tuple(fractions)


DivisionMethod = LongDivision | TableNewton


@lru_cache(maxsize=32)
def reciprocal_table(index_bits: int) -> tuple[int, ...]:
    """Reciprocals of the midpoints of 2**index_bits intervals of [1/2, 1), index_bits + 2 fraction bits."""
    count = 1 << index_bits
    numerator = 1 << (2 * index_bits + 5)
    return tuple((numerator // (2 * (count + i) + 1) + 1) // 2 for i in range(count))


def divide(
    dividend: int,
    dividend_fraction: int,
    divisor: int,
    divisor_fraction: int,
    form: Fixed,
    rounding: Rounding,
) -> tuple[int, bool]:
    """The quotient of raw integers, rounded once from the exact quotient, then saturated.

    A zero divisor gives the limit of the format on the dividend's side (0 / 0 the highest). Returns the
    raw quotient, and whether the exact one did not fit.
    """
    if divisor == 0:
        return (form.lowest if dividend < 0 else form.highest), True
    # Two bits below the last one kept, the lower one sticky, decide every rounding mode exactly.
    exponent = divisor_fraction - dividend_fraction + form.fraction + 1
    numerator = dividend << max(exponent, 0)
    denominator = divisor << max(-exponent, 0)
    quotient, remainder = divmod(numerator, denominator)
    value = rounded(2 * quotient + (remainder != 0), 2, rounding)
    return _clamped(value, form)


def reciprocal(
    divisor: int, divisor_fraction: int, form: Fixed, rounding: Rounding, method: DivisionMethod
) -> tuple[int, bool]:
    """The reciprocal of a raw integer >= 0 by a method. Returns it, and whether it did not fit."""
    if isinstance(method, LongDivision) or divisor == 0:
        return divide(1, 0, divisor, divisor_fraction, form, rounding)
    bits = divisor.bit_length()
    approximation = table_newton(divisor, method, form)
    fraction = method.fractions(form)[-1]
    value = rounded(approximation, fraction + bits - divisor_fraction - form.fraction, rounding)
    return _clamped(value, form)


def table_newton(divisor: int, method: TableNewton, form: Fixed) -> int:
    """2**bits / divisor, between 1 and 2, with ``method.fractions(form)[-1]`` fraction bits.

    ``bits`` is the length of the divisor. With t the approximation and m = divisor / 2**bits an
    iteration is t (2 - m t), its factor 2 - m t truncated to two bits more than the result keeps.
    """
    bits, k = divisor.bit_length(), method.index_bits
    index = ((divisor << k) >> (bits - 1)) & ((1 << k) - 1)
    fractions = method.fractions(form)
    value = reciprocal_table(k)[index]
    for fraction, target in pairwise(fractions):
        exact = (1 << (bits + fraction + 1)) - divisor * value
        kept = target + 2
        factor = rounded(exact, bits + fraction - kept, Rounding.FLOOR)
        value = (value * factor) >> (fraction + kept - target)
    return value


def _clamped(value: int, form: Fixed) -> tuple[int, bool]:
    clamped = min(max(value, form.lowest), form.highest)
    return clamped, clamped != value
