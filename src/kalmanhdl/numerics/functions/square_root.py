"""Square roots digit by digit, exact, in rows of one subtraction."""

from fractions import Fraction
from math import isqrt

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.numerics.functions.circuit import Circuit


def square_root(circuit: Circuit, a: int, fraction: int) -> int:
    """The square root of a, rounded down to so many fraction bits; zero for a below zero.

    The remainder of a digit is what a, cut after two bits for each digit of the root, exceeds the root's
    square by; it is never more than twice the root.
    """
    low, high = circuit.bounds(a)
    if high <= 0:
        return circuit.constant(0)
    if low < 0:
        a = circuit.where_negative(a, circuit.constant(0), a)
    exponent = -(-_length(high) // 2)
    root = remainder = circuit.constant(0)
    for digits, place in enumerate(range(1 - exponent, fraction + 1), start=1):
        weight = Fraction(2) ** -place
        pair = circuit.bits(a, Fixed(width=2, fraction=2 * place, signed=False))
        brought_down = circuit.add(remainder, pair)
        square = circuit.add(circuit.shift(root, 1 - place), circuit.constant(weight * weight))
        rest = circuit.subtract(brought_down, square)
        digit = circuit.where_negative(rest, circuit.constant(0), circuit.constant(weight))
        greatest = 2 * ((1 << digits) - 1) * weight * weight
        remainder = circuit.within(
            circuit.where_negative(rest, brought_down, rest), Fraction(0), greatest, 2 * place
        )
        root = circuit.add(root, digit)
    return circuit.within(root, Fraction(0), root_above(high, fraction))


def root_above(value: Fraction, fraction: int) -> Fraction:
    """At least the square root of a value, by less than two units of a last bit."""
    scaled = value * Fraction(4) ** fraction
    return (isqrt(scaled.numerator // scaled.denominator) + 1) / Fraction(2) ** fraction


def _length(value: Fraction) -> int:
    """The least n with value < 2**n."""
    n = value.numerator.bit_length() - value.denominator.bit_length()
    return n + 1 if value >= Fraction(2) ** n else n
