"""All exact algorithms say the same."""

import numpy as np
import pytest

from kalmanhdl.algorithm import ALGORITHMS, Conventional
from linear_models import EXACT, estimated, random_model, random_plots

OTHERS = sorted(set(EXACT) - {"conventional"})


def assert_equal_estimates(found, expected, tolerance):
    """Means relative to themselves and their state's greatest deviation, covariances to the latter."""
    # The numbers of the models are about one; a state that is known exactly has variances of rounding.
    deviation = np.sqrt(np.maximum(np.nanmax(np.einsum("...ii->...i", expected.P), axis=(0, 1)), 1e-6))
    size = 1 + np.abs(expected.x) / deviation
    assert np.nanmax(np.abs(found.x - expected.x) / deviation / size) < tolerance
    correlation = np.abs(found.P - expected.P) / deviation[..., None] / deviation[..., None, :]
    assert np.nanmax(correlation) < tolerance
    np.testing.assert_allclose(found.innovation, expected.innovation, rtol=tolerance, atol=10 * tolerance)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=tolerance, atol=10 * tolerance)


@pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")
@pytest.mark.parametrize("kind", OTHERS)
@pytest.mark.parametrize("batch", range(10))
def test_every_algorithm_agrees_with_the_conventional_one_whatever_is_missed(kind, batch):
    random = np.random.default_rng(batch)
    for _ in range(50):
        model = random_model(random)
        z = random_plots(random, model)
        expected = estimated(model, Conventional(), z)
        assert np.isfinite(expected.x).all()
        assert_equal_estimates(estimated(model, ALGORITHMS[kind](), z), expected, 1e-9)
