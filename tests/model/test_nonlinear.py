"""What a nonlinear model says of itself, and what it refuses."""

import numpy as np
import pytest

from kalmanhdl.errors import ModelError
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.model import Seen
from kalmanhdl.model.nonlinear import Measured, nonlinear_model
from kalmanhdl.model.state_space import Initial
from kalmanhdl.model.units import Units


def made(**more):
    facts = {
        "f": ["a + 0.1*b", "b"],
        "h": ["2*a - 3", "1/b"],
        "Q": np.eye(2),
        "R": np.eye(2),
        "initial": given([1.0, 2.0], np.eye(2)),
        "state_names": ["a", "b"],
        "measurement_names": ["first", "second"],
    }
    return nonlinear_model(**{**facts, **more})


def test_a_measurement_of_one_state_is_seen_as_one():
    assert made().seen == {0: Seen(state=0, factor=2.0, offset=-3.0)}
    units = Units(
        state=np.array([4.0, 2.0]),
        measurement=np.array([0.5, 1.0]),
        control=np.ones(0),
        covariance=np.ones(2),
    )
    assert made().in_units(units).seen == {0: Seen(state=0, factor=16.0, offset=-6.0)}


def test_what_a_measurement_depends_on_is_what_its_formula_names():
    np.testing.assert_array_equal(made().dependence, [[True, False], [False, True]])


def test_a_start_that_rests_on_noise_takes_it_into_its_covariance():
    start = Initial(
        x=np.zeros(2),
        from_measurement=np.array([[0.5, 0.0], [0.0, 0.0]]),
        from_state=np.zeros((2, 2)),
        P=np.diag([0.0, 3.0]),
        points=1,
        before_update=False,
        from_noise=np.array([[0.5, 0.0], [0.0, 0.0]]),
    )
    model = made(initial=start, R=np.diag([4.0, 1.0]), measurement_range=[[0, 1], [0, 1]])
    x, P = model.start(np.zeros(2), np.array([6.0, 0.0], object), np.zeros(0))
    np.testing.assert_array_equal(x.astype(float), [3.0, 0.0])
    np.testing.assert_array_equal(P.astype(float), np.diag([1.0, 3.0]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Q": np.eye(3)}, "Q is 3 x 3"),
        ({"Q": -np.eye(2)}, "a variance is 0 or greater"),
        ({"R": np.zeros((2, 2))}, "a variance is greater than 0"),
        ({"R": [1.0]}, "R is 1"),
        ({"state_names": "ab"}, "a list of 1 to 64 names"),
        ({"state_names": ["a", "a"]}, "stands twice"),
        ({"state_names": ["a", "first"]}, "'first' is a measurement or a control too"),
        ({"state_names": ["a", "pi"]}, "'pi' has a meaning of its own"),
        ({"measurement_names": ["first", "track"]}, "is a column of its own"),
        ({"constants": {"b": 1.0}}, "'b' is a constant too"),
        ({"angles": ["third"]}, "neither a measurement nor a state"),
        ({"initial": given([1.0], np.eye(2))}, "x has 2 numbers"),
        ({"initial": given([1.0, 2.0], np.eye(2), at="before_first")}, "has no such start"),
        ({"initial": two_point()}, "two_point"),
        ({"initial": Measured(["first", "third"], np.eye(2))}, r"x\[1\]: the name 'third' is unknown"),
        ({"initial": Measured(["first", 0], np.eye(2))}, "measurement_range is missing"),
        ({"initial": Measured(["first", 0], np.eye(3))}, "P is 3 x 3"),
        ({"G": [["a"], ["b"], ["a"]], "Q": [[1.0]]}, "G has 2 rows"),
        ({"G": "ab", "Q": [[1.0]]}, "G has 2 rows"),
        ({"G": [["a", 1], ["b", 0]], "Q": [[1.0]]}, "Q is 1 x 1"),
        ({"G": [["a"], ["c"]], "Q": [[1.0]]}, r"G\[1\]: the name 'c' is unknown"),
        ({"measurement_range": [[0, 1]]}, "one \\[low, high\\] for each of 2"),
        ({"h": lambda x: [x[0]]}, "h has 1 formulas: write 2"),
    ],
)
def test_what_cannot_be_is_refused_in_one_message(change, message):
    with pytest.raises(ModelError, match=message) as refused:
        made(**change)
    assert "\n" not in str(refused.value)
