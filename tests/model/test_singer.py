"""The Singer model against 60 digits, the exponential of its matrix, and the models at its ends."""

import csv
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from kalmanhdl.errors import ModelError
from kalmanhdl.model.motion import constant_acceleration, constant_velocity
from kalmanhdl.model.singer import singer

DATA = Path(__file__).parents[1] / "data"
ROWS = list(csv.DictReader((DATA / "singer_FQ_60digits.csv").open()))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"tau={row['tau_s']}, T={row['T_s']}")
def test_every_entry_is_the_nearest_double(row):
    motion = singer(T=float(row["T_s"]), tau=float(row["tau_s"]), noise=float(row["sigma_m"]))
    for matrix, letter in ((motion.F, "F"), (motion.Q, "Q")):
        for i, j in np.argwhere(np.triu(np.ones((3, 3)))):
            text = row.get(f"{letter}{i + 1}{j + 1}")
            if text is not None:
                assert matrix[i, j] == float(Decimal(text))
    np.testing.assert_array_equal(motion.Q, motion.Q.T)
    np.testing.assert_array_equal(np.tril(motion.F, -1), 0)


@given(T=st.floats(0.01, 30), ratio=st.floats(0.5, 20), sigma=st.floats(0.01, 10))
def test_continuous_noise_is_the_integral_of_white_noise(T, ratio, sigma):
    # Van Loan (1978), in units in which the period is 1.
    tau = T * ratio
    A = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -1 / ratio]])
    noise = np.diag([0, 0, 2 * sigma**2 / ratio])
    whole = expm(np.block([[-A, noise], [np.zeros_like(A), A.T]]))
    F = whole[3:, 3:].T
    motion = singer(T=T, tau=tau, noise=sigma)
    unit = np.array([T**2, T, 1])
    np.testing.assert_allclose(motion.F / unit[:, None] * unit, F, rtol=1e-9, atol=1e-12)
    Q = F @ whole[:3, 3:]
    np.testing.assert_allclose(motion.Q / np.outer(unit, unit), Q, rtol=1e-6, atol=1e-9 * sigma**2)


@given(T=st.floats(0.01, 30), ratio=st.floats(0.05, 20))
def test_piecewise_noise_is_the_response_to_a_constant(T, ratio):
    A = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -1 / ratio]])
    driven = expm(np.block([[A, np.eye(3)[:, 2:]], [np.zeros((1, 4))]]))[:3, 3]
    gain = driven * np.array([T**3, T**2, T])
    motion = singer(T=T, tau=T * ratio, noise=2.0, discretisation="piecewise")
    np.testing.assert_allclose(motion.Q, 4 * np.outer(gain, gain), rtol=1e-9)


@pytest.mark.parametrize("T", [0.8192e-3, 1.0, 15.0])
def test_a_long_memory_is_constant_acceleration_and_a_short_one_constant_velocity(T):
    long = singer(T=T, tau=T * 1e18, noise=1.0)
    jerk = constant_acceleration(T=T, noise=2 / (T * 1e18), discretisation="continuous")
    np.testing.assert_allclose(long.F, jerk.F, rtol=1e-15)
    np.testing.assert_allclose(long.Q, jerk.Q, rtol=1e-15)
    short = singer(T=T, tau=T * 1e-18, noise=1.0)
    white = constant_velocity(T=T, noise=2 * (T * 1e-18), discretisation="continuous")
    np.testing.assert_allclose(short.Q[:2, :2], white.Q, rtol=1e-15)


@pytest.mark.parametrize(("T", "tau"), [(1e-29, 1e29), (1e29, 1e-29), (1e-6, 1e9)])
def test_far_ratios_stay_finite_and_semidefinite(T, tau):
    motion = singer(T=T, tau=tau, noise=1.0)
    assert np.isfinite(motion.F).all()
    root = np.sqrt(np.diag(motion.Q))
    assert np.linalg.eigvalsh(motion.Q / np.outer(root, root))[0] > -1e-9


def test_the_model_of_wu2012_in_its_order_of_states():
    """Phi and Gamma as printed in eq. 3 and 4, whose cancellation in doubles leaves some digits."""
    T, alpha, gamma = 0.8192e-3, 0.001, 0.0129
    motion = singer(T=T, tau=1 / alpha, noise=gamma, axes=3, discretisation="piecewise", order="derivative")
    names = ("x", "y", "z", "x_rate", "y_rate", "z_rate")
    assert motion.state_names == (*names, "x_acceleration", "y_acceleration", "z_acceleration")
    np.testing.assert_array_equal(motion.H, np.eye(3, 9))
    kept = np.exp(-alpha * T)
    F = np.kron([[1, T, T**2 / 2], [0, 1, T], [0, 0, kept]], np.eye(3))
    np.testing.assert_allclose(motion.F, F, rtol=1e-6)
    gain = np.kron(gamma * np.array([[T**3 / 6], [T**2 / 2], [T]]), np.eye(3))
    np.testing.assert_allclose(motion.Q, gain @ gain.T, rtol=1e-6)
    # The printed forms themselves, where they do not cancel.
    alpha, T = 0.5, 2.0
    lost = alpha * T + np.exp(-alpha * T) - 1
    motion = singer(T=T, tau=2.0, noise=gamma, discretisation="piecewise")
    position = (1 - alpha * T - np.exp(-alpha * T) + T**2 * alpha**2 / 2) / alpha**3
    column = gamma * np.array([position, lost / alpha**2, (1 - np.exp(-alpha * T)) / alpha])
    np.testing.assert_allclose(motion.Q, np.outer(column, column), rtol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tau": 0}, "[model] tau = 0: a time constant is a positive number of seconds"),
        ({"tau": float("inf")}, "tau = inf"),
        ({"tau": True}, "tau = True"),
        ({"order": "alphabet"}, 'write "axis" or "derivative"'),
        ({"discretisation": "zoh"}, 'write "piecewise" or "continuous"'),
    ],
)
def test_a_singer_model_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ModelError) as caught:
        singer(**{"T": 1.0, "tau": 10.0, "noise": 1.0, **arguments})
    assert message in str(caught.value)
