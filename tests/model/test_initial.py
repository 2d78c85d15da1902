"""How tracks start."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given as forall
from hypothesis import settings
from hypothesis import strategies as st

from kalmanhdl.algorithm import Conventional
from kalmanhdl.errors import ModelError
from kalmanhdl.model.initial import given, three_point, two_point
from kalmanhdl.model.motion import constant_acceleration
from kalmanhdl.model.singer import singer
from kalmanhdl.model.state_space import Dynamics, linear_model
from kalmanhdl.simulate.reference import reference

T = 15.0
F = np.kron(np.eye(2), [[1, T], [0, 1]])
H = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0]])
Q = np.diag([0, 330.0, 0, 1.3e-8])
R = np.diag([1e6, 2.9e-4])


def test_two_point_start_of_lee1997_has_the_papers_covariance():
    start = linear_model(F, H, Q, R, initial=two_point()).initial
    np.testing.assert_allclose(start.P[:2, :2], [[1e6, 1e6 / T], [1e6 / T, 330 + 2e6 / T**2]])
    np.testing.assert_allclose(start.P[2:, 2:], [[2.9e-4, 2.9e-4 / T], [2.9e-4 / T, 1.3e-8 + 5.8e-4 / T**2]])
    assert not start.P[:2, 2:].any()
    assert (start.points, start.before_update) == (2, False)


def test_two_point_start_agrees_with_the_radar_of_bozic():
    # Bozic (1979), computed in 50 digits.
    expected = np.zeros((4, 4))
    expected[:2, :2] = [[1000000, 66666.666666666666667], [66666.666666666666667, 9219.6388888888888889]]
    expected[2:, 2:] = [[2.89e-4, 1.9266666666666667e-5], [1.9266666666666667e-5, 2.5818088107638889e-6]]
    variance = T**2 * 2.1**2 / 3
    noise = np.diag([0, variance, 0, variance / 160e3**2])
    start = linear_model(F, H, noise, np.diag([1e6, 0.017**2]), initial=two_point()).initial
    np.testing.assert_allclose(start.P, expected, rtol=1e-12)


numbers = st.floats(0.2, 3) | st.floats(-3, -0.2)


@forall(
    a=numbers,
    c=numbers,
    period=numbers,
    h=st.tuples(numbers, numbers),
    d=st.tuples(numbers, numbers),
    offset=st.lists(numbers, min_size=3, max_size=3),
    seed=st.integers(0, 2**32 - 1),
)
def test_two_point_error_is_what_two_noisy_rows_leave(a, c, period, h, d, offset, seed):
    """Plays the start for one unit of each noise in turn: the error is linear in them."""
    chance = np.random.default_rng(seed)
    root_q, root_r = chance.normal(size=(3, 3)), chance.normal(size=(2, 2))
    F = np.array([[a, 0, period], [0, 1.0, 0], [0, 0, c]])
    H = np.array([[0, h[0], 0], [h[1], 0, 0]])
    Q, R = root_q @ root_q.T, root_r @ root_r.T + np.eye(2)
    model = linear_model(F, H, Q, R, offset=offset, measurement_offset=d, initial=two_point())
    start = model.initial

    def error(w, v1, v2):
        first = chance.normal(size=3)
        second = F @ first + offset + w
        kept = np.zeros(3)
        for x, v in ((first, v1), (second, v2)):
            kept = start.x + start.from_measurement @ (H @ x + d + v) + start.from_state @ kept
        return second - kept

    units = np.eye(7)
    columns = np.stack([error(unit[:3], unit[3:5], unit[5:]) for unit in units], axis=1)
    noises = np.zeros((7, 7))
    noises[:3, :3], noises[3:5, 3:5], noises[5:, 5:] = Q, R, R
    np.testing.assert_allclose(error(np.zeros(3), np.zeros(2), np.zeros(2)), 0, atol=1e-9)
    expected = columns @ noises @ columns.T
    np.testing.assert_allclose(start.P, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("F", "H", "B", "message"),
    [
        (np.eye(3), np.eye(2, 3), None, "x2 is neither measured nor a rate of measured states"),
        (np.array([[1, 1, 0.5], [0, 1, 1], [0, 0, 1]]), np.eye(1, 3), None, "moved by more than one state"),
        (np.array([[1, 1.0], [0, 1]]), np.ones((1, 2)), None, "measurement 0 depends on 2 states"),
        (np.array([[1, 1.0], [0, 1]]), np.array([[1.0, 0], [2, 0]]), None, "x0 is measured twice"),
        (np.array([[1, 1.0], [0, 1]]), np.eye(1, 2), [[0], [1]], "controls move x0 or x1"),
        (np.array([[1, 1.0], [0.1, 1]]), np.eye(1, 2), None, "the rate x1 does not keep its value"),
    ],
)
def test_two_point_refuses_models_it_does_not_suit_and_says_what_does(F, H, B, message):
    with pytest.raises(ModelError) as caught:
        linear_model(F, H, np.eye(len(F)), np.eye(len(H)), B=B, initial=two_point())
    assert message in str(caught.value)
    assert 'use kind = "given" with x and P' in str(caught.value)


def test_two_point_takes_another_covariance():
    start = linear_model(F, H, Q, R, initial=two_point(P=np.diag([4.0, 3, 2, 1]))).initial
    np.testing.assert_array_equal(start.P, np.diag([4.0, 3, 2, 1]))


def test_a_belief_before_the_first_row_is_predicted_to_it():
    x, P, offset = np.arange(4.0), np.diag([4.0, 3, 2, 1]), np.ones(4)
    start = linear_model(F, H, Q, R, offset=offset, initial=given(x, P, at="before_first")).initial
    np.testing.assert_allclose(start.x, F @ x + offset)
    np.testing.assert_allclose(start.P, F @ P @ F.T + Q)
    assert (start.points, start.before_update) == (1, True)


def test_a_belief_at_the_first_row_is_kept():
    x, P = np.arange(4.0), np.diag([4.0, 3, 2, 0])
    start = linear_model(F, H, Q, R, initial=given(x, P)).initial
    np.testing.assert_array_equal(start.x, x)
    np.testing.assert_array_equal(start.P, P)
    assert not start.from_measurement.any()
    assert not start.from_state.any()


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (given([0] * 3, np.eye(4)), "[model.initial] x is 3: x has 4 numbers, one a state"),
        (given([0] * 4, np.eye(3)), "[model.initial] P is 3 x 3"),
        (given([0] * 4, -np.eye(4)), "[model.initial] P[0,0] = -1: a variance is 0 or greater"),
        (given([0] * 4, np.eye(4), at="later"), 'write "first" or "before_first"'),
        (given([1e308] * 4, np.eye(4), at="before_first"), "is not finite"),
    ],
)
def test_a_belief_that_cannot_be_is_refused(rule, message):
    with pytest.raises(ModelError) as caught:
        linear_model(F, H, Q, R, initial=rule)
    assert message in str(caught.value)


def test_three_point_start_of_constant_acceleration_takes_differences():
    motion = constant_acceleration(T=0.5, noise=2.0)
    start = linear_model(motion.F, motion.H, np.zeros((3, 3)), [[4.0]], initial=three_point()).initial
    assert (start.points, start.before_update) == (3, False)
    kept = np.array([1e6, -1e6, 1e6])  # whatever a track before has left
    for z in (7.0, 3.0, 2.0):
        kept = start.from_measurement @ [z] + start.from_state @ kept
    np.testing.assert_allclose(kept, [2, (3 * 2 - 4 * 3 + 7) / (2 * 0.5), (2 - 2 * 3 + 7) / 0.5**2])
    # The covariance of those differences under R alone.
    by_row = np.array([[1, 0, 0], [3, -4, 1], [4, -8, 4]])
    np.testing.assert_allclose(start.P, 4 * by_row @ by_row.T)


@settings(deadline=None)
@forall(
    T=st.floats(0.01, 10),
    ratio=st.floats(0.3, 30),
    axes=st.integers(1, 3),
    order=st.sampled_from(["axis", "derivative"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_three_point_error_is_what_three_noisy_rows_leave(T, ratio, axes, order, seed):
    """Plays the start for one unit of each noise in turn: the error is linear in them."""
    chance = np.random.default_rng(seed)
    motion = singer(T=T, tau=T * ratio, noise=1.0, axes=axes, order=order)
    n, m = 3 * axes, axes
    unit = np.array([{"": T**2, "rate": T, "acceleration": 1.0}[name[2:]] for name in motion.state_names])
    root_r = chance.normal(size=(m, m))
    R = (root_r @ root_r.T + np.eye(m)) * T**4
    offset, d = chance.normal(size=n) * unit, chance.normal(size=m) * T**2
    model = linear_model(
        motion.F, motion.H, motion.Q, R, offset=offset, measurement_offset=d, initial=three_point()
    )
    start = model.initial

    def error(w2, w3, v1, v2, v3):
        x1 = chance.normal(size=n) * unit
        x2 = motion.F @ x1 + offset + w2
        x3 = motion.F @ x2 + offset + w3
        kept = chance.normal(size=n) * unit
        for x, v in ((x1, v1), (x2, v2), (x3, v3)):
            kept = start.x + start.from_measurement @ (motion.H @ x + d + v) + start.from_state @ kept
        return (x3 - kept) / unit

    sizes = [n, n, m, m, m]
    noises = [motion.Q, motion.Q, R, R, R]
    np.testing.assert_allclose(error(*map(np.zeros, sizes)), 0, atol=1e-10)
    expected = np.zeros((n, n))
    for k, size in enumerate(sizes):
        columns = []
        for i in range(size):
            parts = [np.zeros(s) for s in sizes]
            parts[k][i] = unit[i] if size == n else T**2
            columns.append(error(*parts))
        weights = unit if size == n else np.full(m, T**2)
        J = np.stack(columns, axis=1) / weights
        expected += J @ noises[k] @ J.T
    P = start.P / np.outer(unit, unit)
    np.testing.assert_allclose(P, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


def test_three_point_covariance_is_that_of_many_tracks():
    """The reference starts 100 000 tracks that the model draws; the error of each entry is known."""
    motion = singer(T=1.5, tau=20.0, noise=3.0, axes=2)
    R = np.array([[25.0, 6.0], [6.0, 16.0]])
    model = linear_model(motion.F, motion.H, motion.Q, R, initial=three_point())
    chance, tracks = np.random.default_rng(3), 100_000
    noise = chance.standard_normal((3, tracks, 6))
    truth = model.trajectories(np.zeros((tracks, 6)), np.zeros((3, tracks, 0)), noise, chance)
    z = truth @ motion.H.T + chance.standard_normal((3, tracks, 2)) @ np.linalg.cholesky(R).T
    found = reference(Conventional()(model), np.zeros((3, tracks), np.int8), z, np.zeros((3, tracks, 0)))
    error = found.x[2] - truth[2]
    P = model.initial.P
    np.testing.assert_array_equal(found.P[2, 0], P)
    deviation = np.sqrt((np.outer(np.diag(P), np.diag(P)) + P**2) / tracks)
    assert np.all(np.abs(error.T @ error / tracks - P) < 4.5 * deviation)
    assert np.all(np.abs(error.mean(axis=0)) < 4.5 * np.sqrt(np.diag(P) / tracks))


@pytest.mark.parametrize(
    ("F", "H", "B", "message"),
    [
        (np.eye(2), np.eye(1, 2), None, "2 states are not three for each of 1 measurements"),
        (np.diag([1.0, 1, 0]), np.ones((1, 3)), None, "F has no inverse"),
        (np.eye(3), np.eye(1, 3), None, "three rows do not determine the states"),
        (np.diag([1.0, 2, 3]), np.ones((1, 3)), [[1], [0], [0]], "controls move the states"),
    ],
)
@pytest.mark.filterwarnings("ignore:no sequence")
def test_three_point_refuses_models_it_does_not_suit_and_says_what_does(F, H, B, message):
    with pytest.raises(ModelError) as caught:
        linear_model(F, H, np.eye(len(F)), np.eye(len(H)), B=B, initial=three_point())
    assert f'"three_point": {message}' in str(caught.value)
    assert 'use kind = "given" with x and P' in str(caught.value)


def test_a_start_says_what_its_covariance_owes_to_the_measurements():
    start = two_point()(dynamics := _dynamics())
    by_hand = start.P.copy()
    for gain in np.hsplit(start.from_noise, 2):
        by_hand += gain @ dynamics.R @ gain.T
    np.testing.assert_allclose(linear_model(F, H, Q, R, initial=two_point()).initial.P, by_hand)
    assert linear_model(F, H, Q, R, initial=two_point()).initial.from_noise is None


@pytest.mark.parametrize("columns", [3, 34])
def test_a_start_from_noise_that_cannot_be_is_refused(columns):
    start = replace(two_point()(_dynamics()), from_noise=np.ones((4, columns)))
    with pytest.raises(ModelError, match="from_noise is 4 x 2, or 4 x a multiple of 2"):
        linear_model(F, H, Q, R, initial=start)


def _dynamics():
    zeros = {"B": np.zeros((4, 0)), "offset": np.zeros(4), "measurement_offset": np.zeros(2)}
    return Dynamics(F=F, H=H, Q=Q, R=R, state_names=("a", "b", "c", "d"), **zeros)
