"""A model is checked once, when it is made."""

import warnings
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given as forall
from hypothesis import strategies as st

from kalmanhdl.errors import ModelError
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import LinearModel, linear_model
from kalmanhdl.validation import KalmanhdlWarning

GOOD = {
    "F": [[1, 1], [0, 1]],
    "H": [[1, 0]],
    "Q": [[0, 0], [0, 1]],
    "R": [[1]],
    "initial": given([0, 0], np.eye(2)),
}


def model(**changes):
    return linear_model(**{**GOOD, **changes})


def test_a_model_has_its_defaults():
    made = model(B=[[0], [1]])
    assert (made.n, made.m, made.p) == (2, 1, 1)
    assert made.state_names == ("x0", "x1")
    assert made.measurement_names == ("z0",)
    assert made.control_names == ("u0",)
    assert made.measurement_range is None
    assert model().B.shape == (2, 0)


def test_arrays_of_a_model_cannot_be_changed():
    source = np.eye(2)
    made = model(F=source, H=np.eye(2), R=np.eye(2))
    with pytest.raises(ValueError, match="read-only"):
        made.F[0, 0] = 5
    source[0, 0] = 5
    assert made.F[0, 0] == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"F": [[1, 1]]}, "[model] F is 1 x 2: F is square"),
        ({"F": [1, 2]}, "[model] F is 2: F is n x n"),
        ({"F": "abc"}, "[model] F = 'abc' is no array of real numbers: F is n x n"),
        ({"F": [[1, 2], [3]]}, "is no array of real numbers"),
        ({"F": [[1j, 0], [0, 1]]}, "is no array of real numbers"),
        ({"F": [[float("nan"), 0], [0, 1]]}, "[model] F[0,0] = nan is not finite"),
        ({"F": np.eye(65)}, "[model] F is 65 x 65: F is square, with at most 64 states"),
        ({"H": [[1, 0, 0]]}, "[model] H is 1 x 3: H is m x 2, a row a measurement and a column a state"),
        ({"H": np.zeros((0, 2))}, "[model] H is 0 x 2"),
        ({"H": np.ones((65, 2))}, "[model] H has 65 rows: at most 64 measurements"),
        ({"Q": np.eye(3)}, "[model] Q is 3 x 3: Q is 2 x 2, as F"),
        ({"Q": [[1, 0.5], [0.4, 1]]}, "[model] Q is not symmetric: Q[0,1] = 0.5 but Q[1,0] = 0.4: write"),
        ({"Q": [[1, 2], [2, 1]]}, "[model] Q is indefinite: Q[0,1] = 2 exceeds"),
        ({"Q": [[-1, 0], [0, 1]]}, "[model] Q[0,0] = -1: a variance is 0 or greater"),
        ({"Q": [[0, 1], [1, 1]]}, "[model] Q[0,1] = 1 but Q[0,0] = 0: a variance of 0 has no covariances"),
        ({"R": [[0]]}, "[model] R[0,0] = 0: a variance is greater than 0"),
        ({"H": np.eye(2), "R": [[1, 1], [1, 1]]}, "[model] R is not positive definite"),
        ({"B": [[1]]}, "[model] B is 1 x 1: B is 2 x p, a row a state and a column a control"),
        ({"offset": [1]}, "[model] offset is 1: 2 numbers, one a state"),
        ({"measurement_offset": [float("inf")]}, "[model] measurement_offset[0] = inf is not finite"),
        ({"state_names": ["a"]}, "[model] state is 1 names: give a list of 2"),
        ({"state_names": ["a", "a"]}, "[model] state: 'a' stands twice"),
        ({"state_names": ["a", "b c"]}, "'b c' is no name: use letters, digits and _"),
        ({"state_names": ["a", "b" * 65]}, "has 65 characters: a name has at most 64"),
        ({"measurement_names": ["track"]}, "[model] measurement: 'track' is a column of its own in data"),
        ({"measurement_names": ["truth_x"]}, "'truth_x' is a column of its own"),
        ({"measurement_names": ["u0"], "B": [[0], [1]]}, "[model] control: 'u0' is a measurement too"),
        ({"state_units": ["m", "m\n"]}, "is no unit"),
        ({"measurement_range": [[1, 1]]}, "[model] measurement_range[0] = [1, 1]: the first must be less"),
        ({"measurement_range": [[1, 2], [1, 2]]}, "[model] measurement_range is 2 x 2: one [low, high]"),
    ],
)
def test_a_model_that_cannot_be_is_refused_by_name(changes, message):
    with pytest.raises(ModelError) as caught:
        model(**changes)
    assert message in str(caught.value)


def test_three_pairwise_sound_covariances_can_be_indefinite_together():
    Q = np.array([[1, 0.9, 0.9], [0.9, 1, -0.9], [0.9, -0.9, 1]])
    with pytest.raises(ModelError, match="Q is not positive semidefinite: its correlation form"):
        model(F=np.eye(3), H=np.eye(3), Q=Q, R=np.eye(3), initial=given([0] * 3, np.eye(3)))


def test_a_covariance_symmetric_to_its_printed_digits_is_made_exactly_so():
    made = model(Q=[[1, 0.3333333333], [0.3333333334, 1]])
    assert made.Q[0, 1] == made.Q[1, 0]


@forall(st.integers(1, 6), st.integers(0, 2**32 - 1), st.integers(-40, 40))
def test_every_rounded_gram_matrix_is_a_covariance(n, seed, exponent):
    root = np.random.default_rng(seed).normal(size=(n, max(n - 1, 1))) * 2.0**exponent
    Q = root @ root.T
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", KalmanhdlWarning)
        made = model(F=np.eye(n), H=np.eye(1, n), Q=Q, initial=given([0] * n, Q))
    np.testing.assert_allclose(made.Q, Q, rtol=1e-12, atol=0)


def test_unobservable_states_are_named_in_a_warning():
    with pytest.warns(KalmanhdlWarning, match="no sequence of measurements determines b, c:"):
        model(
            F=[[1, 0, 0], [0, 1, 1], [0, 0, 1]],
            H=[[1, 0, 0]],
            Q=np.eye(3),
            state_names=["a", "b", "c"],
            initial=given([0] * 3, np.eye(3)),
        )


@pytest.mark.parametrize("T", [1e-7, 1e-3, 1, 1e4])
def test_an_observable_chain_is_no_reason_to_warn(T):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model(
            F=[[1, T, T**2 / 2], [0, 1, T], [0, 0, 1]],
            H=[[1, 0, 0]],
            Q=np.eye(3),
            initial=given([0] * 3, np.eye(3)),
        )


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("F", np.eye(3), "H is"),
        ("R", -np.eye(1), "a variance is greater than 0"),
        ("Q", [[0.0, 1.0], [0.0, 1.0]], "not symmetric"),
        ("Q", [[0.0, np.nan], [np.nan, 1.0]], "not finite"),
        ("state_names", ("a", "a"), "state"),
        ("measurement_names", ("track",), "column of its own"),
        ("initial", replace(model().initial, P=-np.eye(2)), "a variance is 0 or greater"),
        ("nis_weight", np.ones(3), "nis_weight"),
    ],
)
def test_a_model_made_directly_is_checked_too(field, value, message):
    made = model()
    values = {each.name: getattr(made, each.name) for each in fields(made)} | {field: value}
    with pytest.raises(ModelError, match=message):
        LinearModel(**values)
    with pytest.raises(ModelError, match=message):
        replace(made, **{field: value})
