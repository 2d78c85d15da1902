"""Models of other libraries."""

import control
import numpy as np
import pytest
import scipy.signal
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter

from kalmanhdl.errors import ModelError
from kalmanhdl.model.convert import from_filterpy, from_state_space
from kalmanhdl.model.initial import given

A = np.array([[1, 0.5], [0, 0.9]])
B = np.array([[0.1], [0.4]])
C = np.array([[1.0, 0]])
Q, R = np.diag([0.1, 0.2]), np.array([[2.0]])
START = given([1, 2], np.eye(2))


def filterpy_filter():
    kf = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    kf.F, kf.H, kf.Q, kf.R, kf.B = A, C, Q, R, B
    kf.x, kf.P = np.array([[1.0], [2.0]]), np.array([[3.0, 1.0], [1.0, 2.0]])
    return kf


def test_a_filterpy_filter_keeps_its_estimates():
    """Its own predict and update against the equations of the converted model, row by row."""
    kf = filterpy_filter()
    model = from_filterpy(kf, state_names=["level", "trend"])
    chance = np.random.default_rng(1)
    x, P = model.initial.x, model.initial.P
    for row in range(20):
        z, u = chance.normal(size=1), chance.normal(size=1) * (row > 0)
        kf.predict(u=u.reshape(1, 1))
        kf.update(z)
        if row:
            x, P = model.F @ x + model.B @ u, model.F @ P @ model.F.T + model.Q
        gain = P @ model.H.T @ np.linalg.inv(model.H @ P @ model.H.T + model.R)
        x, P = x + gain @ (z - model.H @ x), P - gain @ model.H @ P
        np.testing.assert_allclose(kf.x.ravel(), x, rtol=1e-9)
        np.testing.assert_allclose(kf.P, P, rtol=1e-9)
    assert model.state_names == ("level", "trend")


def test_a_filterpy_filter_with_fading_memory_is_refused():
    kf = filterpy_filter()
    kf.alpha = 1.02
    with pytest.raises(ModelError, match="set alpha to 1"):
        from_filterpy(kf)


@pytest.mark.parametrize("thing", [object(), None, 3, "kf", KalmanFilter, np.eye(2), {"F": 1}])
def test_what_is_no_filter_is_refused(thing):
    with pytest.raises(ModelError, match=r"has no .*: pass a filterpy\.kalman\.KalmanFilter, or give"):
        from_filterpy(thing)


def test_a_filter_of_another_kind_is_named_in_one_line():
    kf = ExtendedKalmanFilter(dim_x=2, dim_z=1)
    with pytest.raises(ModelError, match=r"\AExtendedKalmanFilter has no H: pass a filterpy[^\n]*\Z"):
        from_filterpy(kf)


@pytest.mark.parametrize("thing", [object(), None, 3, "system", np.eye(2), {"A": 1}])
def test_what_is_no_system_is_refused(thing):
    with pytest.raises(ModelError, match="is no state-space system: pass one of"):
        from_state_space(thing, Q, R, initial=START)


def test_a_system_without_matrices_is_refused():
    with pytest.raises(ModelError, match="System has no A: pass a state-space system"):
        from_state_space(type("System", (), {"dt": 1})(), Q, R, initial=START)


@pytest.mark.parametrize(
    "system",
    [
        scipy.signal.dlti(A, B, C, [[0]], dt=0.5),
        scipy.signal.StateSpace(A, B, C, [[0]], dt=0.5),
        control.ss(A, B, C, 0, dt=0.5),
        control.ss(A, B, C, 0, dt=True),
    ],
    ids=["dlti", "scipy", "control", "control without period"],
)
def test_a_discrete_system_becomes_a_model(system):
    model = from_state_space(system, Q, R, initial=START)
    np.testing.assert_array_equal(model.F, A)
    np.testing.assert_array_equal(model.B, B)
    np.testing.assert_array_equal(model.H, C)
    np.testing.assert_array_equal(model.initial.x, [1, 2])


def test_a_discrete_transfer_function_is_realised():
    system = scipy.signal.TransferFunction([1], [1, -1.5, 0.7], dt=1)
    model = from_state_space(system, Q, R, initial=START)
    assert (model.n, model.m, model.p) == (2, 1, 1)


def test_valid_names_of_a_control_system_are_taken_over():
    names = {"states": ["level", "trend"], "outputs": ["gauge"], "inputs": ["valve"]}
    model = from_state_space(control.ss(A, B, C, 0, dt=1, **names), Q, R, initial=START)
    assert (*model.state_names, *model.measurement_names, *model.control_names) == (
        *("level", "trend", "gauge", "valve"),
    )


@pytest.mark.parametrize(
    "system",
    [scipy.signal.lti(A, B, C, [[0]]), scipy.signal.StateSpace(A, B, C, [[0]]), control.ss(A, B, C, 0)],
    ids=["lti", "scipy", "control"],
)
def test_a_continuous_system_is_refused_with_what_to_do(system):
    with pytest.raises(ModelError, match="continuous in time: discretise it first"):
        from_state_space(system, Q, R, initial=START)


def test_a_system_that_feeds_controls_through_is_refused():
    with pytest.raises(ModelError, match="D is not 0"):
        from_state_space(scipy.signal.dlti(A, B, C, [[1]], dt=1), Q, R, initial=START)
