"""Whatever a constructor is given: a value is made, or an error of the project's own names what is wrong."""

import warnings
from fractions import Fraction

import numpy as np
import pytest

from kalmanhdl import from_filterpy, from_state_space
from kalmanhdl.algorithm import Converted, Extended, Scheduled, Taylor
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.design import Architecture, Design, Processor, Target
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.model.converted import converted_model
from kalmanhdl.model.initial import given, three_point, two_point
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.motion import constant_acceleration, constant_velocity
from kalmanhdl.model.multiple import multiple_model
from kalmanhdl.model.nonlinear import Measured, nonlinear_model
from kalmanhdl.model.singer import singer
from kalmanhdl.model.state_space import Initial, LinearModel, linear_model
from kalmanhdl.model.turn import coordinated_turn
from kalmanhdl.model.varying import varying_model
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.shape import Shape
from kalmanhdl.simulate.data import plots_from_arrays

F, ONE, START = [[1.0, 1.0], [0.0, 1.0]], [[1.0]], given([0, 0], np.eye(2))
LINEAR = {"F": F, "H": [[1, 0]], "Q": np.eye(2), "R": ONE, "initial": START}
NAMES = {"state_names": None, "state_units": None, "measurement_names": None, "control_names": None}
MOTION = {"T": 1, "noise": 1, "axes": 1, "discretisation": "piecewise", "order": "axis"}
MODEL = linear_model(**LINEAR)
PLAIN = {
    "x": [0, 0],
    "from_measurement": [[0], [0]],
    "from_state": np.zeros((2, 2)),
    "P": np.eye(2),
    "points": 1,
    "before_update": True,
    "from_control": None,
    "from_noise": None,
}


def started(**keys):
    """A model whose start, or whose rule for one, was made so."""
    rule = keys.pop("rule")
    return linear_model(**{**LINEAR, "initial": rule(**keys)})


class Source:
    """An object of another library's with these attributes."""

    def __init__(self, **attributes):
        vars(self).update(attributes)


CALLS = {
    "Fixed": (Fixed, {"width": 8, "fraction": 4, "signed": True}),
    "FixedSpecification": (
        FixedSpecification,
        {
            "width": 16,
            "classes": {},
            "signals": {},
            "rounding": "floor",
            "overflow": "wrap",
            "coast": 5,
            "scale": "auto",
            "covariance_scale": "auto",
            "division": "radix2",
            "functions": None,
            "headroom": {},
        },
    ),
    "FloatSpecification": (
        FloatSpecification,
        {"exponent": 8, "mantissa": 23, "rounding": "half_even", "subnormals": True, "fused": False},
    ),
    "FloatSpecification of a word": (FloatSpecification, {"format": "single"}),
    "Architecture": (
        Architecture,
        {
            "interval": None,
            "channels": 1,
            "clock_mhz": None,
            "multiplier_blocks": None,
            "lanes": 1,
            "multiplier": "booth",
            "units": {"divide": 1},
            "latency": None,
            "iterative": (),
            "clocks": None,
            "updates_per_second": None,
            "solver_seconds": 1.0,
            "streams": "one",
            "coefficients": "fixed",
        },
    ),
    "Processor": (
        Processor,
        {"size": 3, "width": 32, "fraction": 16, "multipliers": 9, "matrices": 64, "program_words": 512},
    ),
    "Target": (Target, {"device": "ecp5-25k", "grade": 6, "seeds": 1, "rounds": 2, "derate": {"add": 1.5}}),
    "Design": (
        Design,
        {
            "name": "a",
            "model": MODEL,
            "algorithm": "joseph",
            "numerics": FixedSpecification(),
            "architecture": Architecture(),
            "target": Target(),
            "processor": None,
            "shape": None,
        },
    ),
    "Shape": (
        Shape,
        {
            "units": {"multiply": 2, "add": 2, "reciprocal": 1},
            "rows": 256,
            "words": 64,
            "operand_width": 18,
            "word_width": 48,
            "states": 4,
            "measurements": 2,
            "controls": 1,
        },
    ),
    "linear_model": (
        linear_model,
        {
            **LINEAR,
            **NAMES,
            "B": [[1], [0]],
            "offset": None,
            "measurement_offset": None,
            "measurement_range": None,
        },
    ),
    "LinearModel": (
        LinearModel,
        {
            **LINEAR,
            "initial": Initial(**PLAIN),
            "B": np.zeros((2, 0)),
            "offset": [0, 0],
            "measurement_offset": [0],
            "state_units": ["", ""],
            "state_names": ["a", "b"],
            "measurement_names": ["z"],
            "control_names": [],
            "measurement_range": None,
            "nis_weight": None,
        },
    ),
    "given": (started, {"rule": given, "x": [0, 0], "P": np.eye(2), "at": "before_first"}),
    "two_point": (started, {"rule": two_point, "P": np.eye(2)}),
    "Initial": (started, {"rule": Initial, **PLAIN}),
    "constant_velocity": (constant_velocity, MOTION),
    "constant_acceleration": (constant_acceleration, MOTION),
    "singer": (singer, {**MOTION, "tau": 5}),
    "coordinated_turn": (
        coordinated_turn,
        {"T": 1, "noise": 1, "turn_rate": 0.1, "axes": 2, "discretisation": "piecewise", "order": "axis"},
    ),
    "converted_model": (
        converted_model,
        {
            "F": np.eye(2),
            "H": np.eye(2),
            "Q": np.eye(2),
            "R": np.diag([1, 0.01]),
            "initial": START,
            **NAMES,
            "B": None,
            "offset": None,
            "measurement_range": None,
        },
    ),
    "varying_model": (
        varying_model,
        {
            "F": [["dt"]],
            "H": ONE,
            "Q": ONE,
            "R": ONE,
            "inputs": [RunTimeInput(name="dt", low=1, high=2)],
            "initial": given([0], ONE),
            "B": None,
            "offset": None,
            "measurement_offset": None,
            **NAMES,
            "control_names": (),
            "constants": {"a": 1.0},
            "measurement_range": None,
        },
    ),
    "RunTimeInput": (
        lambda **keys: varying_model(
            [["dt"]], ONE, ONE, ONE, inputs=[RunTimeInput(**keys)], initial=given([0], ONE)
        ),
        {"name": "dt", "low": 1, "high": 2, "from_time": False},
    ),
    "nonlinear_model": (
        nonlinear_model,
        {
            "f": ["a*x"],
            "h": ["x^2"],
            "Q": ONE,
            "R": ONE,
            "initial": given([0], ONE),
            "G": [[1]],
            "state_names": ["x"],
            "state_units": None,
            "measurement_names": ["z"],
            "control_names": (),
            "measurement_range": None,
            "inputs": (),
            "angles": (),
            "constants": {"a": 0.5},
        },
    ),
    "Measured": (
        lambda **keys: nonlinear_model(
            f=["x"],
            h=["x"],
            Q=ONE,
            R=ONE,
            state_names=["x"],
            measurement_names=["z"],
            measurement_range=[[0, 1]],
            initial=Measured(**keys),
        ),
        {"x": ["z"], "P": ONE},
    ),
    "multiple_model": (
        multiple_model,
        {"modes": [MODEL, MODEL], "transition": [[0.9, 0.1], [0.1, 0.9]], "probabilities": None},
    ),
    "from_filterpy": (
        lambda **keys: from_filterpy(Source(**keys)),
        {"F": F, "H": [[1, 0]], "Q": np.eye(2), "R": ONE, "x": [0, 0], "P": np.eye(2), "B": None}
        | {"alpha": 1.0, "M": 0.0},
    ),
    "from_state_space": (
        lambda Q, R, initial, names, **keys: from_state_space(
            Source(**keys), Q, R, initial=initial, state_names=names
        ),
        {"A": F, "B": [[1], [0]], "C": [[1, 0]], "D": 0, "dt": 1.0, "Q": np.eye(2), "R": ONE}
        | {"initial": START, "names": None},
    ),
    "Taylor": (Taylor, {"about": "identity", "newton": 0}),
    "Scheduled": (Scheduled, {"steps": "auto"}),
    "Converted": (Converted, {"unbiasing": "debiased", "at": "measurement"}),
    "Extended": (Extended, {"joseph": False}),
}

ANYTHING = [
    *(None, True, 5, -1, 0, 1.5, float("nan"), float("inf"), 10**400, 1j, Fraction(1, 2), "x", "", b"x"),
    *([], [1], ["x"], [[]], [None], [[1], [1, 2]], (1,), {}, {"x": 1}, {"x": "x"}, {5: 5}, {1, 2}),
    *(object(), int, lambda: 0, lambda *_: 5, two_point, iter([1])),
    *(np.array(3), np.array([1, 2]), np.array(["a", "b"]), ["a", "b"], np.array([[1.0]]), np.eye(2)),
    *(np.array([[1, "x"], [None, 2]], object), np.float32(1), np.int64(1), np.bool_(True)),
    *(np.datetime64("2026"), np.ma.array([[1.0, 2.0]], mask=[[True, False]]), [["y"]], [[np.nan]], MODEL),
]


def complaint(call, **keys):
    """What a call that is refused on purpose says."""
    try:
        call(**keys)
    except KalmanhdlError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, (_, keys) in CALLS.items() for key in keys])
def test_whatever_a_constructor_is_given_no_raw_exception_comes(name, key):
    call, keys = CALLS[name]
    if key == "rule":
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        call(**keys)
        for value in ANYTHING:
            assert "\n" not in complaint(call, **{**keys, key: value})


@pytest.mark.parametrize("key", ["z", "u", "time"])
def test_whatever_measurements_are_no_raw_exception_comes(key):
    model = linear_model(**LINEAR, B=[[1], [0]])
    for value in ANYTHING:
        given_arrays = {"z": [[1.0]], "u": [[1.0]], "time": [0.0], key: value}
        assert "\n" not in complaint(plots_from_arrays, model=model, **given_arrays)


def test_three_points_start_what_they_can():
    motion = constant_acceleration(T=np.float32(1), noise=np.array([1.0]), axes=["x"])
    model = linear_model(motion.F, motion.H, motion.Q, ONE, initial=three_point())
    assert model.initial.points == 3
