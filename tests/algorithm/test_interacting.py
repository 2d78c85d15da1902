"""Interacting multiple models, against filterpy and by what a mixture must do."""

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter

from kalmanhdl.algorithm.conventional import Conventional
from kalmanhdl.algorithm.interacting import Interacting
from kalmanhdl.algorithm.trace import components, trace
from kalmanhdl.errors import ModelError
from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.model.initial import given
from kalmanhdl.model.multiple import multiple_model
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.reference import reference

T = 1.0
F = np.kron(np.eye(2), [[1, T], [0, 1]])
H = np.kron(np.eye(2), [[1.0, 0.0]])
R = np.array([[4.0, 0.5], [0.5, 9.0]])
x0, P0 = np.array([0.0, 1.0, 5.0, -1.0]), 10 * np.eye(4)
START = given(x0, P0)
BETWEEN = np.array([[0.95, 0.05], [0.1, 0.9]])


def noise(q):
    return np.kron(np.eye(2), q * np.array([[T**4 / 4, T**3 / 2], [T**3 / 2, T**2]]))


def model(start=START):
    modes = [linear_model(F, H, noise(q), R, initial=start) for q in (0.01, 4.0)]
    return multiple_model(modes, BETWEEN, [0.6, 0.4])


def track(steps=60, seed=5):
    random = np.random.default_rng(seed)
    x, z = x0.copy(), np.empty((steps, 2))
    for k in range(steps):
        x = F @ x + (20 < k < 30) * np.array([0.5, 1, -0.5, -1])
        z[k] = H @ x + np.linalg.cholesky(R) @ random.standard_normal(2)
    return z


def run(z, found_model):
    z = z[:, None, :]
    given_commands = commands(found_model, z, np.ones(z.shape[:2], bool))
    return reference(Interacting()(found_model), given_commands, z, np.zeros((*z.shape[:2], 0)))


def test_estimates_are_those_of_filterpy():
    z = track()
    filters = []
    for q in (0.01, 4.0):
        peer = KalmanFilter(4, 2)
        peer.F, peer.H, peer.Q, peer.R = F, H, noise(q), R
        peer.x, peer.P = x0[:, None].copy(), P0.copy()
        filters.append(peer)
    start = given(x0, P0, at="before_first")
    # The peer mixes before its first prediction as well; equal beliefs stay as they are.
    imm = IMMEstimator(filters, np.array([0.6, 0.4]) @ np.linalg.inv(BETWEEN), BETWEEN)
    found = run(z, model(start))
    for k, row in enumerate(z):
        imm.predict()
        imm.update(row[:, None])
        np.testing.assert_allclose(found.x[k, 0], imm.x[:, 0], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.P[k, 0], imm.P, rtol=1e-9, atol=1e-9)


def test_equal_modes_are_one_filter():
    one = linear_model(F, H, noise(0.3), R, initial=given(x0, P0))
    z = track()
    z[10:13] = np.nan
    z[15, 1] = np.nan
    found = run(z, multiple_model([one, one], BETWEEN))
    alone = reference(
        Conventional()(one),
        commands(one, z[:, None], np.ones((60, 1), bool)),
        z[:, None],
        np.zeros((60, 1, 0)),
    )
    np.testing.assert_allclose(found.x, alone.x, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.P, alone.P, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.nis, alone.nis, rtol=1e-9, atol=1e-10)


def test_a_missed_row_leaves_the_modes_to_their_chain():
    z = np.full((200, 2), np.nan)
    filter_ = Interacting()(model())
    graph = trace(model(), filter_)
    state = {name: np.zeros(1) for name, _ in graph.states}
    for k in range(len(z)):
        leaves = {**state, "initialise": np.array([k == 0]), "z[0]": np.zeros(1), "z[1]": np.zeros(1)}
        leaves |= {"valid[0]": np.array([False]), "valid[1]": np.array([False])}
        with np.errstate(all="ignore"):
            values = evaluate(graph, leaves)
        state = {name: np.broadcast_to(values[root], 1) for name, root in graph.states}
    mu = [state[f"mu[{j}]"][0] for j in range(2)]
    np.testing.assert_allclose(mu, [2 / 3, 1 / 3], rtol=1e-9)


def test_the_graph_computes_what_the_algorithm_does():
    z = track(12)
    z[5] = np.nan
    z[7, 0] = np.nan
    found = run(z, model())
    graph = trace(model(), Interacting()(model()))
    outputs = dict(graph.outputs)
    state = {name: np.zeros(1) for name, _ in graph.states}
    for k, row in enumerate(z):
        leaves = {**state, "initialise": np.array([k == 0])}
        leaves |= {f"z[{j}]": np.nan_to_num(row[j : j + 1]) for j in range(2)}
        leaves |= {f"valid[{j}]": ~np.isnan(row[j : j + 1]) for j in range(2)}
        with np.errstate(all="ignore"):
            values = evaluate(graph, leaves)
        state = {name: np.broadcast_to(values[root], 1) for name, root in graph.states}
        for i in range(4):
            np.testing.assert_allclose(values[outputs[f"x[{i}]"]], found.x[k, :, i], rtol=1e-8, atol=1e-9)
            np.testing.assert_allclose(values[outputs[f"P[{i},{i}]"]], found.P[k, :, i, i], rtol=1e-8)
    assert {"mu[0]", "mu[1]"} <= set(outputs)


def test_modes_couple_what_each_leaves_apart():
    axes = [linear_model(F, H, noise(q), np.diag([4.0, 9.0]), initial=given(x0, P0)) for q in (0.01, 4.0)]
    graph = trace(axes[0], Conventional()(axes[0]))
    assert len(components(graph)) == 2
    both = multiple_model(axes, BETWEEN)
    assert components(trace(both, Interacting()(both))) == (("x[0]", "x[1]", "x[2]", "x[3]"),)


@pytest.mark.parametrize(
    ("transition", "probabilities", "message"),
    [
        ([[0.9, 0.2], [0.1, 0.9]], None, "transition are no probabilities"),
        ([[0.9, 0.1], [0.1, 0.9]], [0.5, 0.6], "probabilities are no probabilities"),
        ([[1.0]], None, r"transition.*2 x 2"),
    ],
)
def test_probabilities_that_are_none_are_refused(transition, probabilities, message):
    one = linear_model(F, H, noise(0.3), R, initial=given(x0, P0))
    with pytest.raises(ModelError, match=message):
        multiple_model([one, one], transition, probabilities)


def test_modes_of_other_states_are_refused():
    one = linear_model(F, H, noise(0.3), R, initial=given(x0, P0))
    other = linear_model(
        F[:2, :2], H[:1, :2], noise(0.3)[:2, :2], R[:1, :1], initial=given(x0[:2], P0[:2, :2])
    )
    with pytest.raises(ModelError, match=r"modes\[1\]"):
        multiple_model([one, other], BETWEEN)
    with pytest.raises(ModelError, match='"conventional" does not suit a multiple model: use "interacting"'):
        Conventional()(model())
