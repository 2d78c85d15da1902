"""The extended filter against the linear one, against filterpy, and against its own graph."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from kalmanhdl import math as elementwise
from kalmanhdl.algorithm import ALGORITHMS, Conventional, Extended, Joseph
from kalmanhdl.algorithm.filter import Given, step
from kalmanhdl.algorithm.trace import trace
from kalmanhdl.design import Design
from kalmanhdl.errors import ModelError
from kalmanhdl.graph.balance import balanced
from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.model.initial import given
from kalmanhdl.model.nonlinear import Measured, nonlinear_model
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.model.units import Units
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.reference import reference
from random_formulas import random_formula

T = 0.7


def estimates(model, algorithm, z, u=None):
    z = z[:, None, :]
    u = np.zeros((*z.shape[:2], 0)) if u is None else u[:, None, :]
    return reference(algorithm(model), commands(model, z, np.ones(z.shape[:2], bool)), z, u)


def radar(**more):
    given_start = given([300.0, -4.0, 200.0, 3.0], np.diag([400.0, 9.0, 400.0, 9.0]))
    facts = {
        "f": ["x + T*vx", "vx", "y + T*vy", "vy"],
        "h": ["hypot(x, y)", "atan2(y, x)"],
        "Q": np.kron(np.eye(2), 0.2 * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])),
        "R": np.diag([25.0, 4e-4]),
        "initial": given_start,
        "state_names": ["x", "vx", "y", "vy"],
        "measurement_names": ["range", "bearing"],
        "constants": {"T": T},
        "angles": ["bearing"],
    }
    return nonlinear_model(**{**facts, **more})


def track(steps, seed, missed=0.0):
    """A straight track around the sensor, seen in range and bearing. Truth (steps, 4), plots (steps, 2)."""
    random = np.random.default_rng(seed)
    x = np.array([300.0, -12.0, 200.0, -7.0])
    F = np.kron(np.eye(2), [[1.0, T], [0.0, 1.0]])
    truth = np.array([np.linalg.matrix_power(F, k) @ x for k in range(steps)])
    z = np.stack([np.hypot(truth[:, 0], truth[:, 2]), np.arctan2(truth[:, 2], truth[:, 0])], axis=1)
    z += random.standard_normal(z.shape) * [5.0, 0.02]
    z[:, 1] = np.remainder(z[:, 1] + np.pi, 2 * np.pi) - np.pi
    z[random.random(z.shape) < missed] = np.nan
    return truth, z


@pytest.mark.parametrize("joseph", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_on_a_linear_model_it_is_the_linear_filter(seed, joseph):
    random = np.random.default_rng(seed)
    n, m = 3, 2
    F, H = 0.5 * random.standard_normal((n, n)), random.standard_normal((m, n))
    H[0, :2] = 0.0
    B, offset, shift = random.standard_normal((n, 1)), random.standard_normal(n), random.standard_normal(m)
    Q, R = np.diag(random.uniform(0.1, 1.0, n)), np.array([[1.0, 0.2], [0.2, 0.5]]) * (seed % 2)
    R += 0.7 * np.eye(m)
    start = given(random.standard_normal(n), np.diag(random.uniform(0.5, 2.0, n)))
    linear = linear_model(F, H, Q, R, initial=start, B=B, offset=offset, measurement_offset=shift)
    nonlinear = nonlinear_model(
        lambda x, u: F.astype(object) @ x + B.astype(object) @ u + offset,
        lambda x: H.astype(object) @ x + shift,
        Q,
        R,
        initial=start,
        state_names=["a", "b", "c"],
        measurement_names=["z0", "z1"],
        control_names=["u0"],
    )
    z, u = random.standard_normal((30, m)), random.standard_normal((30, 1))
    z[random.random(z.shape) < 0.2] = np.nan
    algorithm = Joseph() if joseph else Conventional()
    found, expected = estimates(nonlinear, Extended(joseph=joseph), z, u), estimates(linear, algorithm, z, u)
    for name in ("x", "P", "innovation", "nis"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12, atol=1e-12)


def test_a_track_in_range_and_bearing_is_filtered_as_filterpy_does():
    model, (_, z) = radar(), track(80, seed=4)
    found = estimates(model, Extended(), z)
    kf = ExtendedKalmanFilter(dim_x=4, dim_z=2)
    kf.x, kf.P = np.array([300.0, -4.0, 200.0, 3.0]), np.diag([400.0, 9.0, 400.0, 9.0])
    kf.F, kf.Q, kf.R = np.kron(np.eye(2), [[1.0, T], [0.0, 1.0]]), model.Q, model.R

    def slope(x):
        r = np.hypot(x[0], x[2])
        return np.array([[x[0] / r, 0, x[2] / r, 0], [-x[2] / r**2, 0, x[0] / r**2, 0]])

    def residual(a, b):
        y = a - b
        y[1] = np.remainder(y[1] + np.pi, 2 * np.pi) - np.pi
        return y

    for k, row in enumerate(z):
        if k:
            kf.predict()
        kf.update(
            row, slope, lambda x: np.array([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])]), residual=residual
        )
        np.testing.assert_allclose(found.x[k, 0], kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.P[k, 0], kf.P, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("joseph", [False, True])
def test_a_track_is_followed_through_half_a_turn_and_missed_plots(joseph):
    truth, z = track(120, seed=9, missed=0.2)
    assert (np.abs(np.diff(z[:, 1])) > 5).any(), "the bearing passes from pi to -pi"
    start = given([300.0, 0.0, 200.0, 0.0], np.diag([400.0, 100.0, 400.0, 100.0]))
    found = estimates(radar(initial=start), Extended(joseph=joseph), z)
    error = found.x[30:, 0] - truth[30:]
    assert np.sqrt((error[:, [0, 2]] ** 2).mean()) < 8.0
    assert np.sqrt((error[:, [1, 3]] ** 2).mean()) < 1.5
    assert np.abs(found.innovation[:, 0, 1]).max() < 0.3


def test_a_start_from_the_first_plot_is_as_good_as_the_plot():
    start = Measured(["range*cos(bearing)", 0, "range*sin(bearing)", 0], np.diag([0.0, 100.0, 0.0, 100.0]))
    model = radar(initial=start, measurement_range=[[10, 1000], [-np.pi, np.pi]])
    z = np.array([[np.nan, 0.5], [300.0, 0.5], [301.0, np.nan]])
    found = estimates(model, Extended(), z)
    assert np.isnan(found.x[0]).all()
    c, s = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(found.x[1, 0], [300 * c, 0, 300 * s, 0], rtol=1e-14)
    J = np.array([[c, -300 * s], [0, 0], [s, 300 * c], [0, 0]])
    expected = J @ model.R @ J.T + np.diag([0.0, 100.0, 0.0, 100.0])
    np.testing.assert_allclose(found.P[1, 0], expected, rtol=1e-12, atol=1e-12)


def test_noise_by_a_gain_is_what_it_does_to_the_state():
    facts = {
        "f": ["p + T*v*cos(a)", "q + T*v*sin(a)", "v", "a + T*w"],
        "h": ["p", "q"],
        "R": np.eye(2),
        "initial": given([1.0, 2.0, 3.0, 0.4], np.eye(4)),
        "state_names": ["p", "q", "v", "a"],
        "measurement_names": ["p_plot", "q_plot"],
        "control_names": ["w"],
        "constants": {"T": T},
        "angles": ["a"],
    }
    gain = [["T^2/2*cos(a)", 0], ["T^2/2*sin(a)", 0], ["T", 0], [0, "T"]]
    Q = np.diag([0.5, 0.2])
    z, u = np.full((2, 2), np.nan), np.array([[0.0], [0.3]])
    found = estimates(nonlinear_model(Q=Q, G=gain, **facts), Extended(), z, u)
    c, s = np.cos(0.4), np.sin(0.4)
    F = np.eye(4)
    F[:2, 2:] = [[T * c, -T * 3 * s], [T * s, T * 3 * c]]
    G = np.array([[T**2 / 2 * c, 0], [T**2 / 2 * s, 0], [T, 0], [0, T]])
    np.testing.assert_allclose(found.x[1, 0], [1 + T * 3 * c, 2 + T * 3 * s, 3, 0.4 + T * 0.3], rtol=1e-14)
    np.testing.assert_allclose(found.P[1, 0], F @ F.T + G @ Q @ G.T, rtol=1e-13, atol=1e-14)
    constant = nonlinear_model(Q=Q, G=[[0, 0], [0, 0], [T, 0], [0, "T"]], **facts)
    np.testing.assert_allclose(constant.Q, np.diag([0, 0, T**2 * 0.5, T**2 * 0.2]), rtol=1e-14)


def test_a_state_that_is_an_angle_stays_within_half_a_turn():
    model = nonlinear_model(
        ["a + 1"],
        ["a"],
        [[0.01]],
        [[0.1]],
        initial=given([3.0], [[0.1]]),
        state_names=["a"],
        measurement_names=["heading"],
        angles=["a", "heading"],
    )
    truth = np.remainder(3.0 + np.arange(20) + np.pi, 2 * np.pi) - np.pi
    found = estimates(model, Extended(), truth[:, None])
    np.testing.assert_allclose(np.remainder(found.x[:, 0, 0] - truth + 1, 2 * np.pi), 1.0, atol=1e-9)
    assert np.abs(found.x).max() <= np.pi


def random_model(seed):
    random = np.random.default_rng(seed)
    names = ["a", "b", "c"]
    return nonlinear_model(
        [f"0.8*{name} + 0.1*({random_formula(random, [*names, 'v'], 2)})" for name in names],
        ["a + 0.1*b^2", random_formula(random, names, 2)],
        0.1 * np.eye(3),
        np.diag([0.5, 0.3]),
        initial=given([1.0, 1.0, 1.0], 0.1 * np.eye(3)),
        state_names=names,
        measurement_names=["first", "second"],
        control_names=["v"],
        angles=["second"] if seed % 2 else [],
    )


def run(model, filter_, leaves):
    memory = {
        kept.name: kept.whole({p: leaves.get(kept.element(p), np.zeros(5)) for p in kept.places()})
        for kept in filter_.kept
    }
    z, u = np.empty(model.m, object), np.empty(model.p, object)
    z[:] = [leaves.get(f"z[{j}]", np.zeros(5)) for j in range(model.m)]
    for k in range(model.p):
        u[k] = leaves.get(f"u[{k}]", np.zeros(5))
    valid = tuple(leaves[f"valid[{j}]"] for j in range(model.m))
    return step(filter_, memory, Given(z, valid, u, leaves["initialise"]))


@pytest.mark.parametrize("joseph", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_the_graph_computes_what_the_algorithm_does(seed, joseph):
    random = np.random.default_rng(seed)
    units = Units(
        state=2.0 ** random.integers(-3, 4, 3),
        measurement=2.0 ** random.integers(-3, 4, 2),
        control=np.array([0.5]),
        covariance=np.full(3, random.uniform(0.5, 2.0)),
    )
    model = random_model(seed).in_units(units)
    filter_ = Extended(joseph=joseph)(model)
    plain = trace(model, filter_)
    names = [operation.name for operation in plain.operations if hasattr(operation, "name")]
    leaves = {name: random.uniform(0.5, 2.0, 5) for name in names}
    leaves |= {f"P[{i},{i}]": random.uniform(4.0, 8.0, 5) for i in range(3)}
    leaves |= {name: random.random(5) < 0.6 for name in names if name.startswith(("valid", "init"))}
    outcome = run(model, filter_, leaves)
    for graph in (plain, balanced(plain)):
        found = evaluate(graph, leaves)
        belief = {"x": outcome.belief.x, "P": outcome.belief.P}
        for name, root in graph.states:
            letter, _, place = name.rstrip("]").partition("[")
            expected = belief[letter][tuple(map(int, place.split(",")))]
            np.testing.assert_allclose(found[root], expected, rtol=1e-9, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(found[dict(graph.outputs)["nis"]], outcome.nis, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_other_units_say_the_same(seed):
    random, model = np.random.default_rng(seed), random_model(seed)
    d, e, g = 2.0 ** random.integers(-4, 5, 3), 2.0 ** random.integers(-4, 5, 2), np.array([4.0])
    c = np.full(3, 0.37)
    inner = model.in_units(Units(state=d, measurement=e, control=g, covariance=c))
    z, u = random.uniform(0.5, 2.0, (15, 2)), random.uniform(0.5, 1.0, (15, 1))
    found, outer = estimates(inner, Extended(), z / e, u / g), estimates(model, Extended(), z, u)
    np.testing.assert_allclose(found.x * d, outer.x, rtol=1e-9)
    np.testing.assert_allclose(found.P * np.outer(d, d) * 0.37, outer.P, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.nis, outer.nis, rtol=1e-8)


def test_an_algorithm_that_does_not_suit_says_which_does():
    for kind, algorithm in ALGORITHMS.items():
        if kind != "extended":
            with pytest.raises(ModelError, match=f'"{kind}" does not suit a nonlinear model: use "extended"'):
                Design(name="radar", model=radar(), algorithm=algorithm())
    linear = linear_model([[1.0]], [[1.0]], [[1.0]], [[1.0]], initial=given([0.0], [[1.0]]))
    with pytest.raises(ModelError, match='"extended" does not suit a linear model: use "conventional"'):
        Extended()(linear)


def test_functions_of_elements_are_models_as_well():
    model = radar(h=lambda x: [elementwise.hypot(x[0], x[2]), elementwise.atan2(x[2], x[0])])
    _, z = track(20, seed=1)
    found, expected = estimates(model, Extended(), z), estimates(radar(), Extended(), z)
    np.testing.assert_array_equal(found.x, expected.x)
