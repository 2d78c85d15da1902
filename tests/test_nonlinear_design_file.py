"""Nonlinear models as files: what is written loads as the same, whatever the formulas were given as."""

import numpy as np
import pytest

from kalmanhdl import math as elementwise
from kalmanhdl.algorithm import Extended
from kalmanhdl.design import Design
from kalmanhdl.design_file import dumps, loads
from kalmanhdl.errors import OutputError
from kalmanhdl.model.initial import given
from kalmanhdl.model.nonlinear import Measured, nonlinear_model
from random_formulas import random_formula

T = 0.1


def vehicle(**more):
    facts = {
        "f": ["p + T*v*cos(a)", "q + T*v*sin(a)", "v", "a + T*w"],
        "h": ["hypot(p, q)", "atan2(q, p)", "a"],
        "Q": np.diag([0.5, 0.2]),
        "R": np.diag([1.0, 0.01, 0.02]),
        "G": [["T^2/2*cos(a)", 0], ["T^2/2*sin(a)", 0], ["T", 0], [0, "T"]],
        "initial": given([100.0, 50.0, 3.0, 0.4], np.eye(4)),
        "state_names": ["p", "q", "v", "a"],
        "state_units": ["m", "m", "m/s", "rad"],
        "measurement_names": ["r", "b", "compass"],
        "control_names": ["w"],
        "constants": {"T": T},
        "angles": ["a", "b", "compass"],
    }
    return nonlinear_model(**{**facts, **more})


def python(x, u):
    p, q, v, a = x
    speed = T * v
    return [p + speed * elementwise.cos(a), q + speed * elementwise.sin(a), v, elementwise.wrap(a + T * u[0])]


STARTS = [
    given([100.0, 50.0, 3.0, 0.4], np.eye(4)),
    Measured(["r*cos(b)", "r*sin(b)", 0, "compass + T*w"], np.diag([0, 0, 9.0, 0])),
    Measured(lambda z, u: [z[0] * elementwise.cos(z[1]), z[0] * elementwise.sin(z[1]), 0.0, z[2]], np.eye(4)),
]
RANGE = [[1, 500], [-np.pi, np.pi], [-np.pi, np.pi]]


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("f", [vehicle().texts["f"], python])
@pytest.mark.parametrize("constant_gain", [False, True])
def test_what_is_written_loads_as_the_same(start, f, constant_gain):
    gain = (
        [[0, 0], [0, 0], [T, 0], [0, T]] if constant_gain else [["T*cos(a)", 0], [0, "v*w"], ["T", 0], [0, 1]]
    )
    model = vehicle(initial=start, f=f, measurement_range=RANGE, G=gain)
    design = Design(name="vehicle", model=model, algorithm=Extended(joseph=True))
    again = loads(dumps(design))
    assert dumps(again) == dumps(design)
    assert again.algorithm == design.algorithm
    for name in (
        "state_names",
        "state_units",
        "measurement_names",
        "control_names",
        "angles",
        "state_angles",
    ):
        assert getattr(again.model, name) == getattr(model, name)
    np.testing.assert_array_equal(again.model.Q, model.Q)
    np.testing.assert_array_equal(again.model.R, model.R)
    random = np.random.default_rng(0)
    x, u, z = (random.uniform(1, 2, count).astype(object) for count in (4, 1, 3))
    for left, right in (
        (again.model.transition(x, u), model.transition(x, u)),
        (again.model.observation(x), model.observation(x)),
        (again.model.process_noise(x, u), model.process_noise(x, u)),
        *zip(again.model.start(x, z, u), model.start(x, z, u), strict=True),
    ):
        np.testing.assert_allclose(left.astype(float), right.astype(float), rtol=1e-14, atol=1e-15)


def test_formulas_keep_their_words():
    text = dumps(Design(name="vehicle", model=vehicle(), algorithm="extended"))
    assert '"p + T*v*cos(a)"' in text
    assert "T = 0.1" in text


def test_a_function_too_long_for_strings_says_so():
    def f(x, u):
        total = x[0]
        for _ in range(24):
            # Each sum stands twice in the next: as a graph it is short, as a string it doubles.
            total = elementwise.sin(total) * elementwise.cos(total)
        return [total, x[1], x[2], x[3]]

    design = Design(name="vehicle", model=vehicle(f=f), algorithm="extended")
    with pytest.raises(OutputError, match=r"model\.f: this Python function is too long as formulas"):
        dumps(design)


@pytest.mark.parametrize("seed", range(20))
def test_random_models_come_back(seed):
    random = np.random.default_rng(seed)
    names = ["p", "q", "v", "a"]
    model = vehicle(
        f=[random_formula(random, [*names, "w"]) for _ in names],
        h=[random_formula(random, names) for _ in range(3)],
    )
    design = Design(name="vehicle", model=model, algorithm="extended")
    again = loads(dumps(design))
    assert again.model.f.graph == model.f.graph
    assert again.model.H.graph == model.H.graph
