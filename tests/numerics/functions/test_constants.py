"""The numbers that functions are built with, to any precision."""

import mpmath
import pytest

from kalmanhdl.numerics.functions import constants

BITS = (3, 24, 53, 200)


def near(value, exact, bits):
    with mpmath.workdps(100):
        return abs(mpmath.mpf(value.numerator) / value.denominator - exact()) <= mpmath.mpf(2) ** -bits


@pytest.mark.parametrize("bits", BITS)
def test_constants_are_within_their_last_bit(bits):
    assert near(constants.pi(bits), lambda: +mpmath.pi, bits)
    assert near(constants.log_2(bits), lambda: mpmath.log(2), bits)
    assert near(constants.log2_e(bits), lambda: 1 / mpmath.log(2), bits)


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("k", [0, 1, 2, 7, 30])
def test_steps_of_cordic_and_of_powers_are_within_their_last_bit(k, bits):
    angle = lambda: mpmath.atan(mpmath.mpf(2) ** -k) / (2 * mpmath.pi)  # noqa: E731
    factors = lambda: mpmath.fprod(1 / mpmath.sqrt(1 + mpmath.mpf(4) ** -i) for i in range(k))  # noqa: E731
    assert near(constants.arctangent(k, bits), angle, bits)
    assert near(constants.log2_of_factor(k, bits), lambda: mpmath.log(1 + mpmath.mpf(2) ** -k, 2), bits)
    assert near(constants.shrinkage(k, bits), factors, bits)


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("sixteenths", [0, 1, 8, 15, 16])
def test_curves_are_within_their_last_bit(sixteenths, bits):
    x = constants.Fraction(sixteenths, 16)
    real = mpmath.mpf(sixteenths) / 16
    assert near(constants.sine_of_quarter(x, bits), lambda: mpmath.sin(real * mpmath.pi / 2), bits)
    assert near(constants.power_of_two(x, bits), lambda: mpmath.mpf(2) ** real, bits)
