"""How tracks start."""

import numpy as np
import pytest
from hypothesis import given as forall
from hypothesis import strategies as st

from kalmanhdl.errors import ModelError
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.state_space import linear_model

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
