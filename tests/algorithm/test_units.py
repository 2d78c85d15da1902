"""A choice of algorithm in other units is the same filter."""

import numpy as np
import pytest

from kalmanhdl.algorithm import ALGORITHMS, Scheduled, Taylor
from kalmanhdl.model.units import Units
from linear_models import EXACT, estimated, random_model, random_plots

CHOICES = [
    *(ALGORITHMS[kind]() for kind in EXACT),
    *(Taylor("identity"), Taylor("initial", 1), Taylor("steady_state")),
    *(Scheduled(), Scheduled(5), Scheduled(0)),
]


@pytest.mark.filterwarnings("ignore::kalmanhdl.validation.KalmanhdlWarning")
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("algorithm", CHOICES, ids=str)
def test_units_of_the_hardware_leave_the_filter_as_it_is(algorithm, seed):
    random = np.random.default_rng(seed)
    model = random_model(random)
    units = Units(
        state=2.0 ** random.integers(-8, 8, model.n),
        measurement=2.0 ** random.integers(-8, 8, model.m),
        control=np.zeros(0),
        covariance=np.full(model.n, random.uniform(0.1, 10.0)),
    )
    z = random_plots(random, model, steps=3)
    expected = estimated(model, algorithm, z)
    inner = algorithm.in_units(model, units.covariances())
    found = estimated(model.in_units(units), inner, z / units.measurement)
    np.testing.assert_allclose(found.x * units.state, expected.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.P * units.covariances(), expected.P, rtol=1e-9, atol=1e-9)
    size = np.nanmax(np.abs(expected.nis))
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-9, atol=1e-9 * size)
