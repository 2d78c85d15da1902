"""The numbers that functions are built with, as fractions of any precision; equal on every machine.

Each is within 2**-bits of the exact value.
"""

from fractions import Fraction
from functools import lru_cache
from itertools import count
from math import isqrt

# Bits that the sums below may lose to their roundings.
_GUARD = 32


@lru_cache(maxsize=64)
def pi(bits: int) -> Fraction:
    """Half of a turn in radians (Machin 1706)."""
    return 16 * _inverse_tangent(Fraction(1, 5), bits + 8) - 4 * _inverse_tangent(Fraction(1, 239), bits + 8)


@lru_cache(maxsize=64)
def log_2(bits: int) -> Fraction:
    """The natural logarithm of two."""
    return 2 * _inverse_hyperbolic_tangent(Fraction(1, 3), bits + 2)


def log2_e(bits: int) -> Fraction:
    """The binary logarithm of Euler's number."""
    return _cut(1 / log_2(bits + 4), bits + 2)


@lru_cache(maxsize=4096)
def arctangent(exponent: int, bits: int) -> Fraction:
    """The angle in turns whose tangent is 2**-exponent."""
    return angle_of(Fraction(1, 1 << exponent), bits)


@lru_cache(maxsize=256)
def angle_of(slope: Fraction, bits: int) -> Fraction:
    """The angle in turns whose tangent is a slope from 0 to 1."""
    if slope == 1:
        return Fraction(1, 8)
    return _cut(_inverse_tangent(slope, bits + 2) / (2 * pi(bits + 4)), bits + 2)


@lru_cache(maxsize=4096)
def log2_of_factor(exponent: int, bits: int) -> Fraction:
    """The binary logarithm of 1 + 2**-exponent."""
    ratio = Fraction(1, (1 << exponent + 1) + 1)
    return _cut(2 * _inverse_hyperbolic_tangent(ratio, bits + 4) / log_2(bits + 4), bits + 2)


@lru_cache(maxsize=256)
def shrinkage(iterations: int, bits: int) -> Fraction:
    """By how much so many rotations of CORDIC lengthen a vector, inverted."""
    squared = Fraction(1)
    for exponent in range(iterations):
        squared *= 1 + Fraction(1, 1 << 2 * exponent)
    scaled = (squared.denominator << 2 * (bits + 2)) // squared.numerator
    return Fraction(isqrt(scaled), 1 << bits + 2)


def sine_of_quarter(x: Fraction, bits: int) -> Fraction:
    """The sine of x quarters of a turn."""
    angle = _cut(x * pi(bits + _GUARD) / 2, bits + _GUARD)
    return _power_series(angle, -angle * angle, (2, 3), bits)


def power_of_two(x: Fraction, bits: int) -> Fraction:
    """2**x for x from 0 to 1."""
    exponent = _cut(x * log_2(bits + _GUARD), bits + _GUARD)
    return _power_series(Fraction(1), exponent, (1,), bits)


def _power_series(first: Fraction, factor: Fraction, divisors: tuple[int, ...], bits: int) -> Fraction:
    """first (1 + factor / d0 (1 + factor / d1 (...))), each d a product of the next few integers."""
    scale = bits + _GUARD
    term, by, total = int(first * (1 << scale)), int(factor * (1 << scale)), 0
    step = len(divisors)
    for round_ in count():
        if not term:
            return Fraction(total, 1 << scale)
        total += term
        divisor = 1
        for d in divisors:
            divisor *= d + step * round_
        term = _toward_zero(term * by, divisor << scale)
    raise AssertionError


def _inverse_tangent(x: Fraction, bits: int) -> Fraction:
    return _odd_series(x, -1, bits)


def _inverse_hyperbolic_tangent(x: Fraction, bits: int) -> Fraction:
    return _odd_series(x, 1, bits)


def _odd_series(x: Fraction, sign: int, bits: int) -> Fraction:
    """x + sign x^3 / 3 + x^5 / 5 + ..."""
    scale = bits + _GUARD
    power, total = int(x * (1 << scale)), 0
    square = x * x * sign
    for divisor in count(1, 2):
        if not power:
            return Fraction(total, 1 << scale)
        total += _toward_zero(power, divisor)
        power = _toward_zero(power * square.numerator, square.denominator)
    raise AssertionError


def _toward_zero(a: int, b: int) -> int:
    return a // b if a >= 0 else -(-a // b)


def _cut(value: Fraction, bits: int) -> Fraction:
    return Fraction(value.numerator * (1 << bits) // value.denominator, 1 << bits)
