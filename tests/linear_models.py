"""Linear models drawn at random that every algorithm must agree on."""

import numpy as np

from kalmanhdl.algorithm import LINEAR, Algorithm
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import LinearModel, linear_model
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.reference import Estimates, reference

EXACT = tuple(kind for kind in LINEAR if kind not in ("scheduled", "taylor"))
"""The algorithms for linear models that are optimal whatever is missed."""


def random_model(random: np.random.Generator, n: int | None = None, m: int | None = None) -> LinearModel:
    """One to nine states, one to four measurements; half of the models have correlated errors, some
    singular Q and P0, some decoupled states."""
    n = n or int(random.integers(1, 10))
    m = m or int(random.integers(1, 5))
    F = random.standard_normal((n, n)) * (random.random((n, n)) < random.choice([0.3, 1.0])) + np.eye(n)
    F *= random.uniform(0.7, 1.0) / np.abs(np.linalg.eigvals(F)).max()
    H = random.standard_normal((m, n)) * (random.random((m, n)) < random.choice([0.4, 1.0]))
    if random.random() < 0.3:
        H = np.eye(n)[random.integers(0, n, m)] * random.choice([1.0, -2.0, 0.3], size=(m, 1))
    R = _covariance(random, m) if random.random() < 0.6 else np.diag(random.uniform(0.3, 3.0, m))
    if m > 2 and random.random() < 0.3:
        R[0, 1:] = R[1:, 0] = 0.0
    return linear_model(
        F,
        H,
        _noise(random, n),
        R,
        initial=given(
            random.standard_normal(n), 3 * _noise(random, n), at=random.choice(["first", "before_first"])
        ),
    )


def _covariance(random: np.random.Generator, n: int) -> np.ndarray:
    root = random.standard_normal((n, n))
    return root @ root.T / n + 0.3 * np.eye(n)


def _noise(random: np.random.Generator, n: int) -> np.ndarray:
    """A covariance that may be singular."""
    kind = random.random()
    if kind < 0.2:
        return np.diag(random.uniform(0.1, 2.0, n) * (random.random(n) < 0.6))
    if kind < 0.3:
        root = random.standard_normal((n, 1))
        return root @ root.T
    return _covariance(random, n)


def random_plots(
    random: np.random.Generator, model: LinearModel, steps: int = 12, tracks: int = 2, missed: float = 0.25
) -> np.ndarray:
    """Measurements, (steps, tracks, m), one in four of them missed."""
    z = 3 * random.standard_normal((steps, tracks, model.m))
    z[random.random(z.shape) < missed] = np.nan
    return z


def estimated(model: LinearModel, algorithm: Algorithm, z: np.ndarray) -> Estimates:
    """The estimates of an algorithm in double precision; z (steps, tracks, m)."""
    none = np.zeros((*z.shape[:2], model.p))
    return reference(algorithm(model), commands(model, z, np.ones(z.shape[:2], bool)), z, none)
