"""The expansion of the inverse: how good it is, and what it says when it is not."""

import itertools
import re
import warnings
from ast import literal_eval

import numpy as np
import pytest

from kalmanhdl.algorithm import Conventional, Taylor
from kalmanhdl.algorithm.filter import Given
from kalmanhdl.algorithm.steady_state import first_prior, innovation_covariance, optimal_gain, priors
from kalmanhdl.algorithm.taylor import gain_error, spectral_radius
from kalmanhdl.design_file import loads
from kalmanhdl.errors import DesignError, ModelError
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.reference import reference
from kalmanhdl.validation import KalmanhdlWarning
from linear_models import estimated, random_model, random_plots

quiet = pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")


def _gain(model, algorithm, P, used):
    """The gain that an update applies: what a unit of each innovation does to the mean."""
    n, m = model.n, model.m
    filter_ = algorithm(model)
    columns = []
    for j in range(m):
        z = (np.eye(m)[j] + model.measurement_offset).astype(object)
        memory = {"x": np.zeros(n, object), "P": P.astype(object)}
        data = Given(z, tuple(k in used for k in range(m)), np.zeros(0, object), False)
        columns.append(filter_.update(memory, data).memory["x"].astype(float))
    return np.array(columns).T


@quiet
@pytest.mark.parametrize("newton", [0, 1, 3])
@pytest.mark.parametrize("seed", range(40))
def test_the_gain_is_within_its_bound_whatever_is_missed(seed, newton):
    random = np.random.default_rng(seed)
    model = random_model(random)
    about = ["identity", "initial", "steady_state", np.diag(random.uniform(0.5, 3, model.n))][seed % 4]
    algorithm = Taylor(about, newton)
    P0 = algorithm.point(model)
    for P in (P0, 0.7 * P0 + 0.1 * np.eye(model.n), first_prior(model)):
        bound = gain_error(model, P0, P, newton)
        for count in range(1, model.m + 1):
            for used in map(list, itertools.combinations(range(model.m), count)):
                found = _gain(model, algorithm, P, used)
                part = linear_model(
                    model.F,
                    model.H[used],
                    model.Q,
                    model.R[np.ix_(used, used)],
                    initial=given(np.zeros(model.n), np.eye(model.n)),
                )
                exact, S0 = optimal_gain(part, P), innovation_covariance(part, P0)
                L = np.linalg.cholesky(S0)
                difference = np.linalg.norm((found[:, used] - exact) @ L, 2)
                size = np.linalg.norm(exact @ L, 2)
                assert difference <= bound * size * (1 + 1e-9) + 1e-12
                missed = sorted(set(range(model.m)) - set(used))
                assert not found[:, missed].any()


def _covariances(model):
    """A priori covariances of tracks that miss nothing, and of one that misses all."""
    path, coasting = list(itertools.islice(priors(model), 30)), model.initial.P
    for _ in range(12):
        coasting = model.F @ coasting @ model.F.T + model.Q
        path.append(coasting)
    return path


def _radius(model, P0, path):
    return max(spectral_radius(model, P0, P) for P in path)


@quiet
@pytest.mark.parametrize("seed", range(20))
def test_newton_steps_bring_the_estimates_to_the_optimal_ones(seed):
    random = np.random.default_rng(seed)
    radius = 1.0
    while radius > 0.96:
        model = random_model(random)
        path = _covariances(model)
        points = [scale * sum(path) / len(path) for scale in (0.5, 1, 2, 4, 8)]
        radius, P0 = min(((_radius(model, P0, path), P0) for P0 in points), key=lambda pair: pair[0])
    algorithm = Taylor(P0, 8)
    z = random_plots(random, model)
    found, expected = estimated(model, algorithm, z), estimated(model, Conventional(), z)
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-6, atol=1e-6)


def _falling():
    return linear_model(
        [[1.0, 1.0], [0.0, 1.0]],
        [[1.0, 0.0]],
        np.diag([0.0, 0.01]),
        [[1.0]],
        initial=given([0, 0], 100 * np.eye(2)),
    )


def test_an_expansion_that_diverges_is_warned_of_with_one_that_does_not():
    model = _falling()
    with pytest.warns(KalmanhdlWarning, match=r'"steady_state" does not converge .* write about = '):
        Taylor()(model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Taylor("initial")(model)


def _recommended(text):
    """The point that a message recommends."""
    return literal_eval(re.search(r"write about = (\"\w+\"|\[\[.*?\]\])", text)[1])


@pytest.mark.parametrize("coast", [0, 1, 2, 5])
def test_the_point_recommended_converges_however_many_plots_are_missed(coast):
    model, rng = _falling(), np.random.default_rng(coast)
    with pytest.warns(KalmanhdlWarning) as caught:
        Taylor()(model)
    better = Taylor(_recommended(str(caught[0].message)))
    assert better.trouble(model, coast) == ""
    z = rng.standard_normal((400, 8, 1))
    z[np.arange(400) % (coast + 1) > 0] = np.nan
    found = reference(better(model), commands(model, z, np.ones((400, 8), bool)), z, np.zeros((400, 8, 0)))
    assert np.abs(found.x).max() < 1e4


def test_misses_that_make_it_diverge_are_told_with_how_many_it_bears():
    model = _falling()
    trouble = Taylor("initial").trouble(model, 5)
    assert re.search(r"missed 5 times in a row.*write about = \[\[", trouble)
    assert Taylor("initial").trouble(model, 0) == ""
    borne = int(re.search(r"coast = (\d)$", trouble)[1])
    assert Taylor("initial").trouble(model, borne) == ""
    assert Taylor("initial").trouble(model, borne + 1) != ""


def test_the_remedy_may_be_a_covariance_above_all_others():
    model = linear_model(
        np.diag([1.0, 0.99]),
        np.eye(2),
        np.diag([0.0, 5.0]),
        np.eye(2),
        initial=given([0, 0], np.diag([100.0, 0.0])),
    )
    for about in ("initial", "steady_state", "identity"):
        with pytest.warns(KalmanhdlWarning, match=r"write about = \[\["):
            Taylor(about)(model)


def test_the_spectral_radius_is_that_of_the_distance():
    model = linear_model([[1.0]], [[1.0]], [[1.0]], [[1.0]], initial=given([0], [[1]]))
    assert spectral_radius(model, np.array([[1.0]]), np.array([[2.0]])) == pytest.approx(0.5)
    assert gain_error(model, np.array([[1.0]]), np.array([[2.0]]), 1) == pytest.approx(0.5**4)


def test_what_is_no_point_of_expansion_is_refused():
    with pytest.raises(DesignError, match=r"about = 'inital' is unknown: did you mean 'initial'"):
        Taylor("inital")
    with pytest.raises(DesignError, match=r"newton = -1: an integer from 0 to 8"):
        Taylor(newton=-1)
    with pytest.raises(ModelError, match=r"about is 1 x 1: 2 x 2, as F"):
        Taylor([[1.0]])(_falling())
    with pytest.raises(ModelError, match="about is no covariance"):
        Taylor([[1.0, 2.0], [2.0, 1.0]])(_falling())


def test_a_design_file_may_give_the_point():
    text = """
        name = "level"
        [model]
        kind = "linear"
        F = [[1]]
        H = [[1]]
        Q = [[1]]
        R = [[1]]
        [model.initial]
        kind = "given"
        x = [0]
        P = [[1]]
        [algorithm]
        kind = "taylor"
        about = [["3/2"]]
        newton = 1
    """
    assert loads(text).algorithm == Taylor([[1.5]], 1)
    assert loads(text.replace('[["3/2"]]', '"identity"')).algorithm == Taylor("identity", 1)
    with pytest.raises(DesignError, match=r"line 15: \[algorithm\] about = 'idntity' is unknown"):
        loads(text.replace('[["3/2"]]', '"idntity"'))
