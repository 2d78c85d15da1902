"""Gains from a table: what they are, and what becomes of a miss."""

import itertools
import warnings
from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.algorithm import Conventional, Scheduled
from kalmanhdl.algorithm.steady_state import optimal_gain, priors, steady_prior
from kalmanhdl.algorithm.trace import trace
from kalmanhdl.design import Design
from kalmanhdl.errors import DesignError, ModelError
from kalmanhdl.graph.operations import State, Table
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.validation import KalmanhdlWarning
from linear_models import estimated, random_model, random_plots

quiet = pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")


@quiet
@pytest.mark.parametrize("seed", range(60))
def test_estimates_are_the_optimal_ones_while_nothing_is_missed(seed):
    random = np.random.default_rng(seed)
    model = random_model(random)
    z = random_plots(random, model, steps=20, missed=0.0)
    found, expected = estimated(model, Scheduled(25), z), estimated(model, Conventional(), z)
    for name in ("x", "P", "innovation", "nis"):
        size = 1 + np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-9 * size)


def test_two_points_start_the_table_of_a_track():
    model = linear_model(
        [[1.0, 2.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    z = np.cumsum(np.random.default_rng(2).standard_normal((40, 3, 1)), axis=0)
    found, expected = estimated(model, Scheduled(60), z), estimated(model, Conventional(), z)
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.P, expected.P, rtol=1e-9, atol=1e-9)


@quiet
@pytest.mark.parametrize("seed", range(20))
def test_the_steady_covariance_solves_its_riccati_equation(seed):
    model = random_model(np.random.default_rng(seed))
    P = steady_prior(model)
    S = model.H @ P @ model.H.T + model.R
    after = P - P @ model.H.T @ np.linalg.solve(S, model.H @ P)
    np.testing.assert_allclose(
        model.F @ after @ model.F.T + model.Q, P, rtol=1e-9, atol=1e-11 * np.abs(P).max()
    )
    # It is what the model's own start leads to.
    *_, last = itertools.islice(priors(model), 400)
    np.testing.assert_allclose(last, P, rtol=1e-7, atol=1e-9 * np.abs(P).max())


def test_the_steady_gain_alone_keeps_nothing_but_the_mean():
    model = Design.load("designs/lee1997.toml").model
    graph = trace(model, Scheduled(0)(model))
    assert [name for name, _ in graph.states] == [f"x[{i}]" for i in range(4)]
    z = np.random.default_rng(1).standard_normal((30, 1, 2)) * [1000, 0.01]
    found = estimated(model, Scheduled(0), z)
    K = optimal_gain(model, steady_prior(model))
    change = found.x[2:, 0] - found.x[1:-1, 0] @ model.F.T
    np.testing.assert_allclose(change, found.innovation[2:, 0] @ K.T, rtol=1e-9, atol=1e-9)


def test_a_row_of_the_table_is_found_by_a_counter_that_stops_at_the_last():
    model = Design.load("designs/lee1997.toml").model
    graph = trace(model, Scheduled(5)(model))
    bits = {operation.name for operation in graph.operations if isinstance(operation, State)}
    assert {name for name in bits if name.startswith("steps")} == {"steps[0]", "steps[1]", "steps[2]"}
    assert {len(o.rows) for o in graph.operations if isinstance(o, Table)} == {8}
    z = np.zeros((30, 1, 2))
    P = estimated(model, Scheduled(5), z).P
    np.testing.assert_array_equal(P[9:], np.broadcast_to(P[9], P[9:].shape))


def test_a_miss_predicts_and_is_not_counted():
    F = np.array([[1.0, 1.0], [0.0, 1.0]])
    model = linear_model(F, [[1.0, 0.0]], np.diag([0.1, 0.2]), [[2.0]], initial=given([1.0, 0.5], np.eye(2)))
    z = np.array([1.2, np.nan, 3.0, 3.5])[:, None, None]
    found = estimated(model, Scheduled(20), z)
    np.testing.assert_allclose(found.x[1, 0], F @ found.x[0, 0], rtol=1e-14)
    np.testing.assert_array_equal(found.P[1], found.P[0])
    _, prior = itertools.islice(priors(model), 2)
    second = optimal_gain(model, prior)
    np.testing.assert_allclose(
        found.x[2, 0] - F @ found.x[1, 0], second[:, 0] * found.innovation[2, 0, 0], rtol=1e-9
    )


def test_auto_ends_near_the_steady_gain_or_says_that_it_does_not():
    slow = linear_model([[1.0]], [[1.0]], [[1e-6]], [[1.0]], initial=given([0], [[10]]))
    with pytest.warns(KalmanhdlWarning, match=r'"auto" ends after 63 updates'):
        Scheduled()(slow)
    quick = linear_model([[1.0]], [[1.0]], [[1.0]], [[1.0]], initial=given([0], [[100]]))
    z = np.random.default_rng(0).standard_normal((50, 1, 1))
    found, expected = estimated(quick, Scheduled(), z), estimated(quick, Conventional(), z)
    assert np.abs(found.x - expected.x).max() < 0.02
    assert Scheduled().in_units(quick, np.ones((1, 1))).steps < 8


def test_what_cannot_be_scheduled_is_refused():
    with pytest.raises(DesignError, match=r'steps = -1: "auto", or an integer from 0 to 1023'):
        Scheduled(-1)
    with pytest.raises(DesignError, match="steps = 'all'"):
        Scheduled("all")
    with pytest.warns(KalmanhdlWarning):
        growing = linear_model(
            np.diag([1.1, 0.5]), [[0.0, 1.0]], np.eye(2), [[1.0]], initial=given([0, 0], np.eye(2))
        )
    with pytest.raises(ModelError, match="let no covariance come to rest"):
        Scheduled()(growing)


def test_plots_that_are_missed_are_told_to_be_approximated():
    design = replace(Design.load("designs/nile.toml"), algorithm=Scheduled())
    z = np.full((20, 1), 1000.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        design.simulate(z)
    z[[7, 9]] = np.nan
    with pytest.warns(
        KalmanhdlWarning, match=r'2 of 20 measurements are missed: .*"scheduled" goes on with the gains'
    ):
        design.simulate(z)
