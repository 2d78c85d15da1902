"""The definition of typed reciprocals and quotients in integers.

Engine, Verilog and proofs are held to these functions. A divisor is an unsigned raw integer: the
divisors of a Kalman filter are variances.
"""

from dataclasses import dataclass

from kalmanhdl.arithmetic.fixed import Fixed, Rounding, rounded


@dataclass(frozen=True, slots=True, kw_only=True)
class LongDivision:
    """Exact quotient, rounded once; hardware: non-restoring rows of one (radix 2) or two bits (radix 4)."""

    radix: int = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class TableNewton:
    """Reciprocal by a table of the normalised divisor, refined by Newton steps.

    The divisor is shifted left until its leading one stands at the top. Its ``index_bits`` bits after
    the leading one address a table of ``index_bits + 2`` fraction bits; each Newton iteration doubles
    the precision. Zero iterations leave the table alone.
    """

    index_bits: int
    iterations: int


DivisionMethod = LongDivision | TableNewton


def divide(
    dividend: int, dividend_fraction: int, divisor: int, divisor_fraction: int, form: Fixed, rounding: Rounding
) -> tuple[int, bool]:
    """The quotient of raw integers in a format, rounded once from the exact quotient, then saturated.

    A zero divisor gives the limit of the format with the sign of the dividend (0 / 0 gives the highest).
    Returns the raw quotient, and whether the exact one did not fit.
    """
    if divisor == 0:
        return (form.lowest if dividend < 0 and form.signed else form.highest), True
    # Two bits below the last one kept, the lower one sticky, decide every rounding mode exactly.
    exponent = divisor_fraction - dividend_fraction + form.fraction + 1
    numerator = dividend << max(exponent, 0)
    denominator = divisor << max(-exponent, 0)
    quotient, remainder = divmod(numerator, denominator)
    value = rounded(2 * quotient + (remainder != 0), 2, rounding)
    clamped = min(max(value, form.lowest), form.highest)
    return clamped, clamped != value
