"""Motion models against the definitions of their noises."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from kalmanhdl.errors import ModelError
from kalmanhdl.model.motion import constant_acceleration, constant_velocity

MODELS = {2: constant_velocity, 3: constant_acceleration}
periods = st.floats(0.01, 30)
noises = st.floats(0.01, 10)


@pytest.mark.parametrize("order", [2, 3])
@given(T=periods, q=noises)
def test_continuous_noise_is_the_integral_of_white_noise(order, T, q):
    # Van Loan (1978): one matrix exponential gives F and the integral.
    A = np.eye(order, k=1)
    noise = np.zeros((order, order))
    noise[-1, -1] = q
    whole = expm(np.block([[-A, noise], [np.zeros_like(A), A.T]]) * T)
    F = whole[order:, order:].T
    motion = MODELS[order](T=T, noise=q, discretisation="continuous")
    np.testing.assert_allclose(motion.F, F, rtol=1e-12, atol=1e-12 * max(T, 1) ** 2)
    np.testing.assert_allclose(motion.Q, F @ whole[:order, order:], rtol=1e-6, atol=1e-12 * motion.Q.max())


@given(T=periods, sigma=noises)
def test_piecewise_noise_is_one_constant_acceleration_a_period(T, sigma):
    moved = np.array([sigma * T**2 / 2, sigma * T])
    np.testing.assert_allclose(constant_velocity(T=T, noise=sigma).Q, np.outer(moved, moved))
    moved = np.array([sigma * T**2 / 2, sigma * T, sigma])
    np.testing.assert_allclose(constant_acceleration(T=T, noise=sigma).Q, np.outer(moved, moved))


def test_axes_are_independent_and_named():
    motion = constant_velocity(T=2.0, noise=[1.0, 3.0], axes=["range", "bearing"])
    assert motion.state_names == ("range", "range_rate", "bearing", "bearing_rate")
    assert motion.Q.shape == (4, 4)
    assert not motion.Q[:2, 2:].any()
    assert motion.Q[3, 3] == 9 * motion.Q[1, 1]
    np.testing.assert_array_equal(motion.H, [[1, 0, 0, 0], [0, 0, 1, 0]])
    last = constant_acceleration(T=1.0, noise=1.0, axes=3).state_names[-3:]
    assert last == ("z", "z_rate", "z_acceleration")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"T": 0.0, "noise": 1.0}, "[model] T = 0: a period is a positive number of seconds"),
        ({"T": float("nan"), "noise": 1.0}, "T = nan"),
        ({"T": 1.0, "noise": -1.0}, "noise = -1: a finite number of 0 or more"),
        ({"T": 1.0, "noise": [1.0, 2.0]}, "noise has 2 numbers: one, or one for each of the 1 axes"),
        ({"T": 1.0, "noise": 1.0, "axes": 4}, "axes = 4: a number from 1 to 3"),
        ({"T": 1.0, "noise": 1.0, "axes": ["a", "a"]}, "'a' stands twice"),
        ({"T": 1.0, "noise": 1.0, "discretisation": "zoh"}, 'write "piecewise" or "continuous"'),
    ],
)
def test_a_motion_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ModelError) as caught:
        constant_velocity(**arguments)
    assert message in str(caught.value)
