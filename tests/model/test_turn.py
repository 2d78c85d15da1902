"""The turn against the exponential of its matrix."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from kalmanhdl.errors import ModelError
from kalmanhdl.model.motion import constant_velocity
from kalmanhdl.model.turn import coordinated_turn


@given(
    T=st.floats(0.01, 30),
    angle=st.floats(-3.1, 3.1).filter(lambda a: abs(a) > 1e-3),
    q=st.floats(0.01, 10),
)
def test_the_turn_is_the_exponential_of_its_matrix(T, angle, q):
    # Van Loan (1978), in units in which the period is 1.
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1
    A[1, 3], A[3, 1] = -angle, angle
    whole = expm(np.block([[-A, np.diag([0, q, 0, q])], [np.zeros_like(A), A.T]]))
    F = whole[4:, 4:].T
    motion = coordinated_turn(T=T, turn_rate=angle / T, noise=q, discretisation="continuous")
    unit = np.array([T, 1, T, 1])
    np.testing.assert_allclose(motion.F / unit[:, None] * unit, F, rtol=1e-9, atol=1e-12)
    Q = F @ whole[:4, 4:]
    np.testing.assert_allclose(motion.Q / np.outer(unit, unit) / T, Q, rtol=1e-6, atol=1e-9 * q)


def test_a_slow_turn_keeps_every_digit():
    # The first terms of the series, in rationals.
    rate, T = Fraction(1e-9), Fraction(3)
    motion = coordinated_turn(T=3.0, turn_rate=1e-9, noise=1.0, discretisation="continuous")
    assert motion.F[0, 1] == float(T - rate**2 * T**3 / 6)
    assert motion.F[0, 3] == float(-(rate * T**2 / 2 - rate**3 * T**4 / 24))
    assert motion.Q[0, 0] == float(T**3 / 3 - rate**2 * T**5 / 60)
    assert motion.Q[0, 3] == float(rate * T**3 / 6 - rate**3 * T**5 / 120)


@pytest.mark.parametrize("discretisation", ["piecewise", "continuous"])
@pytest.mark.parametrize("order", ["axis", "derivative"])
def test_no_turn_is_constant_velocity(discretisation, order):
    options = {"T": 0.5, "noise": 2.0, "discretisation": discretisation, "order": order}
    turn, straight = coordinated_turn(turn_rate=0, **options), constant_velocity(axes=2, **options)
    np.testing.assert_array_equal(turn.F, straight.F)
    np.testing.assert_array_equal(turn.Q, straight.Q)
    assert turn.state_names == straight.state_names


def test_a_full_circle_comes_back():
    motion = coordinated_turn(T=1.0, turn_rate=math.pi / 6, noise=1.0, axes=["east", "north"])
    np.testing.assert_allclose(np.linalg.matrix_power(motion.F, 12), np.eye(4), atol=1e-14)
    assert motion.state_names == ("east", "east_rate", "north", "north_rate")
    np.testing.assert_array_equal(motion.Q, constant_velocity(T=1.0, noise=1.0, axes=2).Q)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"axes": 3}, "[model] axes are 3: a turn is in a plane, so give two"),
        ({"turn_rate": float("nan")}, "turn_rate = nan: a finite number of rad/s"),
        ({"turn_rate": 4.0}, "turn_rate = 4: at most half a turn in a period of 1 s"),
        ({"noise": -1.0}, "noise = -1"),
    ],
)
def test_a_turn_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ModelError) as caught:
        coordinated_turn(**{"T": 1.0, "turn_rate": 0.1, "noise": 1.0, **arguments})
    assert message in str(caught.value)
