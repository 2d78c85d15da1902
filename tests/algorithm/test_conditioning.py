"""Problems whose covariances no double can hold, against exact values."""

import csv
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.algorithm import BiermanThornton, Conventional
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from linear_models import estimated

# Nothing moves in these problems: they are about one update.
pytestmark = pytest.mark.filterwarnings("ignore:no sequence of measurements")

DATA = Path(__file__).parents[1] / "data"


def _rows(name):
    with (DATA / name).open() as file:
        _, *rows = csv.reader(file)
    return rows


def _symmetric(numbers, n):
    P = np.zeros((n, n))
    P[np.triu_indices(n)] = [float(number) for number in numbers]
    return np.triu(P) + np.triu(P, 1).T


def _updated(algorithm, H, R, P0):
    n, m = len(P0), len(H)
    model = linear_model(np.eye(n), H, np.zeros((n, n)), R, initial=given(np.zeros(n), P0))
    return estimated(model, algorithm, np.zeros((1, 1, m))).P[0, 0]


def _dyer(algorithm, k):
    d = 2.0**-k
    return _updated(algorithm, [[1, 1, 1], [1, 1, 1 + d]], d * d * np.eye(2), np.eye(3))


DYER = [(int(k), _symmetric(P, 3)) for _, k, *P in _rows("dyer_mcreynolds_illconditioned_exact.csv")]
BIERMAN = [(int(k), _symmetric(P, 2)) for k, *P in _rows("bierman_epsilon_exact.csv")]


@pytest.mark.parametrize(("k", "P"), [row for row in DYER if row[0] <= 50])
def test_factors_keep_the_covariance_of_dyer_and_mcreynolds(k, P):
    np.testing.assert_allclose(_dyer(BiermanThornton(), k), P, rtol=1e-8)


def test_the_conventional_filter_loses_it():
    k, P = next(row for row in DYER if row[0] == 28)
    assert not np.abs(_dyer(Conventional(), k) / P - 1).max() < 0.1


@pytest.mark.parametrize(("k", "P"), BIERMAN)
def test_factors_keep_the_covariance_of_bierman(k, P):
    eps = 2.0**-k
    found = _updated(BiermanThornton(), [[1, eps], [1, 1]], np.eye(2), np.eye(2) / eps**2)
    np.testing.assert_allclose(found, P, rtol=1e-8)
