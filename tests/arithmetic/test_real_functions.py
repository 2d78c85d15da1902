"""Functions made of portable operations: as good as those of NumPy, and right where they have corners."""

import math

import numpy as np
import pytest

from kalmanhdl.arithmetic import real_functions as functions

RANDOM = np.random.default_rng(1)
ANGLES = RANDOM.uniform(-3, 3, 4000) * 2.0 ** RANDOM.integers(-30, 8, 4000)
OTHERS = RANDOM.uniform(-3, 3, 4000) * 2.0 ** RANDOM.integers(-30, 8, 4000)


def values(function, *arguments):
    return np.array([function(*each) for each in zip(*(a.tolist() for a in arguments), strict=True)])


def turned(angles):
    """Angles in radians; whole turns are taken off first, exactly."""
    return 2 * np.pi * (angles - np.rint(angles))


def test_sine_and_cosine():
    np.testing.assert_allclose(values(functions.sine, ANGLES), np.sin(turned(ANGLES)), rtol=1e-15, atol=4e-16)
    np.testing.assert_allclose(
        values(functions.cosine, ANGLES), np.cos(turned(ANGLES)), rtol=1e-15, atol=4e-16
    )


def test_arctangent():
    expected = np.arctan2(ANGLES, OTHERS) / (2 * np.pi)
    np.testing.assert_allclose(values(functions.arctangent, ANGLES, OTHERS), expected, rtol=1e-15)


def test_hypotenuse():
    np.testing.assert_allclose(
        values(functions.hypotenuse, ANGLES, OTHERS), np.hypot(ANGLES, OTHERS), rtol=6e-16
    )


def test_exponential():
    x = np.clip(ANGLES, -700, 700)
    np.testing.assert_allclose(values(functions.exponential, x), np.exp(x), rtol=6e-16)


@pytest.mark.parametrize("angle", [-2.5, -1.5, -0.5, 0.5, 1.5, 2.5])
def test_half_a_turn_is_a_negative_one(angle):
    assert functions.wrap(angle) == -0.5


def test_wrap_is_exact():
    found = values(functions.wrap, ANGLES)
    np.testing.assert_array_equal(found, ANGLES - np.floor(ANGLES + 0.5))


def test_quarters_of_a_turn_are_exact():
    for quarter, (sine, cosine) in enumerate(((0, 1), (1, 0), (0, -1), (-1, 0))):
        for turns in (-3, 0, 5):
            assert functions.sine(turns + quarter / 4) == sine
            assert functions.cosine(turns + quarter / 4) == cosine


def test_the_ends_of_the_numbers():
    assert functions.exponential(math.inf) == math.inf
    assert functions.exponential(-math.inf) == 0
    assert functions.exponential(1000) == math.inf
    assert functions.hypotenuse(-math.inf, 1.0) == math.inf
    assert functions.hypotenuse(3e300, 4e300) == 5e300
    assert functions.arctangent(0.0, 0.0) == 0
    assert functions.arctangent(0.0, -1.0) == 0.5
    for function in (functions.sine, functions.cosine, functions.wrap):
        assert math.isnan(function(math.inf))
    for function in (functions.arctangent, functions.hypotenuse):
        assert math.isnan(function(math.nan, 1.0))
