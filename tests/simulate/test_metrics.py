"""Errors and consistency, against tables and against scipy."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from kalmanhdl.simulate import metrics

TABLE = Path(__file__).parent / "nees_nis_chi2_95_bands.csv"


def test_bands_of_means_are_those_of_the_tables():
    rows = list(csv.DictReader(TABLE.open()))
    assert rows
    for row in rows:
        band = metrics.mean_band(int(row["dim"]), int(row["n_runs"]))
        assert band == pytest.approx((float(row["lo95"]), float(row["hi95"])), rel=1e-9)


@given(st.floats(1e-6, 1 - 1e-6), st.integers(1, 300_000))
def test_quantiles_are_those_of_scipy(probability, degrees):
    found = metrics.chi_square_quantile(probability, degrees)
    assert found == pytest.approx(stats.chi2.ppf(probability, degrees), rel=1e-8)


def test_rmse_leaves_out_what_is_missing():
    truth = np.zeros((4, 1, 2))
    estimate = np.array([[[3.0, 1.0]], [[4.0, np.nan]], [[3.0, np.nan]], [[4.0, 1.0]]])
    assert metrics.rmse(estimate, truth) == pytest.approx([np.sqrt(12.5), 1.0])
    assert np.isnan(metrics.rmse(np.full((2, 1, 1), np.nan), np.zeros((2, 1, 1)))).all()


def test_errors_of_their_own_covariance_are_consistent_and_larger_ones_are_not():
    random = np.random.default_rng(1)
    P = np.array([[2.0, 0.5], [0.5, 1.0]])
    error = random.multivariate_normal([0, 0], P, (200, 50))
    honest = metrics.consistency(metrics.nees(error, np.broadcast_to(P, (200, 50, 2, 2))), 2)
    overconfident = metrics.consistency(metrics.nees(error, np.broadcast_to(P / 2, (200, 50, 2, 2))), 2)
    assert honest.consistent
    assert honest.samples == 10_000
    assert overconfident.mean > overconfident.high


def test_white_innovations_have_no_correlation_and_a_random_walk_has():
    white = np.random.default_rng(2).normal(size=(500, 20, 1))
    assert abs(metrics.autocorrelation(white)[0]) < 4 / np.sqrt(499 * 20)
    assert metrics.autocorrelation(np.cumsum(white, axis=0))[0] > 0.9
