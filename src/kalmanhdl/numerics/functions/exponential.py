"""The natural exponential: a power of two, its integer part a shift, its fraction a curve."""

from fractions import Fraction
from math import ceil, floor

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.numerics.functions.circuit import Circuit
from kalmanhdl.numerics.functions.constants import log2_e, log2_of_factor, log_2
from kalmanhdl.numerics.functions.interpolation import POWER, interpolated
from kalmanhdl.numerics.functions.method import Cordic, FunctionMethod

# The argument is cut off where the result is zero, or too large, beyond doubt: in steps of 2**-2.
_LIMIT_STEPS = 4


def exponential(circuit: Circuit, a: int, fraction: int, top: int, method: FunctionMethod) -> int:
    """e**a with so many fraction bits and an error of two units of the last one, below 2**top.

    Where it is more it stays at 2**top or above.
    """
    precision = max(top + fraction + 2, 2)
    exponent = _binary_exponent(circuit, a, fraction, top, precision + 2)
    whole = circuit.floored(exponent, 0)
    part = circuit.bits(exponent, Fixed(width=precision + 2, fraction=precision + 2, signed=False))
    if isinstance(method, Cordic):
        power = _by_factors(circuit, part, precision)
    else:
        power = interpolated(circuit, part, POWER, method.index_bits, precision)
    return circuit.nearest(_shifted(circuit, power, whole, fraction + 3), fraction)


def _binary_exponent(circuit: Circuit, a: int, fraction: int, top: int, kept: int) -> int:
    """a as an exponent of two, no further than the result goes, with so many fraction bits."""
    low = Fraction(floor(-(fraction + 2) * log_2(8) * _LIMIT_STEPS), _LIMIT_STEPS)
    high = Fraction(ceil((top + 1) * log_2(8) * _LIMIT_STEPS), _LIMIT_STEPS)
    a = circuit.clamped(circuit.floored(a, kept + 2), min(low, high), high)
    reach = max(abs(bound) for bound in circuit.bounds(a))
    bits = kept + 2 + ceil(reach + 1).bit_length()
    factor = Fraction(round(log2_e(bits + 2) * (1 << bits)), 1 << bits)
    return circuit.floored(circuit.times(factor, a), kept)


def _by_factors(circuit: Circuit, part: int, precision: int) -> int:
    """2**part by factors 1 + 2**-k, each taken where what is left of the exponent allows it (Muller 2016)."""
    inner = precision + precision.bit_length() + 1
    power, rest = circuit.constant(1), part
    for k in range(1, precision + 2):
        logarithm = Fraction(round(log2_of_factor(k, inner + 2) * (1 << inner)), 1 << inner)
        less = circuit.subtract(rest, circuit.constant(logarithm))
        more = circuit.add(power, circuit.floored(circuit.shift(power, -k), inner))
        power = circuit.within(circuit.where_negative(less, power, more), Fraction(1), Fraction(2))
        # What is left is less than the logarithm of the factor last seen, which is below 1.45 * 2**-k.
        rest = circuit.within(circuit.where_negative(less, rest, less), Fraction(0), Fraction(2, 1 << k))
    return power


def _shifted(circuit: Circuit, a: int, exponent: int, fraction: int) -> int:
    """a * 2**exponent, cut below a fraction."""
    low, high = (int(bound) for bound in circuit.bounds(exponent))
    a = circuit.floored(circuit.shift(a, high), fraction)
    down = circuit.subtract(circuit.constant(high), exponent)
    for level in reversed(range((high - low).bit_length())):
        digit = circuit.bits(down, Fixed(width=level + 1, fraction=0))
        halved = circuit.floored(circuit.shift(a, -(1 << level)), fraction)
        a = circuit.where_negative(digit, halved, a)
    return a
