"""The covariance filter in Joseph's form."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kalmanhdl.algorithm.covariance import corrected, covariance_filter, innovation
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given
from kalmanhdl.algorithm.gain import Observation, normalised_innovation_squared, optimal_gain
from kalmanhdl.algorithm.varying import of_linear
from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, Condition, named, select
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel


@dataclass(frozen=True, slots=True)
class Joseph(Algorithm):
    """Update by P = (I - K H) P (I - K H)' + K R K', liu2007 eq. 4 (Bucy & Joseph, 1968).

    Right for any gain, and a sum of two terms that are positive semidefinite: choose it where the gain
    is coarse or approximate. Multiplications of signals for dense H: about n m (n + m) for the gain, and
    2 n^3 + n^2 m for the covariance; the prediction of P takes about n^2 (3 n + 1) / 2
    by constants for dense F.
    """

    kind: ClassVar[str] = "joseph"

    def __call__(self, model: Model) -> Filter:
        """The filter of a linear model, or of one that varies."""
        return of_linear(model, self, _filter)


def _filter(linear: LinearModel) -> Filter:
    return covariance_filter(linear, lambda prior, given: _update(linear, prior, given))


def _update(model: LinearModel, prior: Belief, given: Given) -> Correction:
    y = innovation(model, prior.x, given)
    return joseph_correction(model, prior, given.valid, y)


def joseph_correction(
    model: Observation, prior: Belief, valid: tuple[Condition, ...], y: Array
) -> Correction:
    """The update by an innovation y (m,), zero where a component is missed."""
    gain = optimal_gain(model, prior, valid)
    P = joseph_covariance(model, prior, named("update: Kv", _of_valid(gain.K, valid)))
    return corrected(prior.x + gain.K @ y, P, y, normalised_innovation_squared(model, gain, y))


def joseph_covariance(model: Observation, prior: Belief, K: Array) -> Array:
    """(I - K H) P (I - K H)' + K R K' for any gain K, whose columns of missed components are zero."""
    A = named("update: A", np.eye(model.n).astype(object) - K @ model.H.astype(object))
    AP = named("update: AP", A @ prior.P)
    KR = named("update: KR", K @ model.R.astype(object))
    return symmetric(AP @ A.T + KR @ K.T)


def _of_valid(K: Array, valid: tuple[Condition, ...]) -> Array:
    """The gain with a column of zeros for every missed component."""
    masked = K.copy()
    for i, j in np.ndindex(*K.shape):
        masked[i, j] = select(valid[j], K[i, j], 0.0)
    return masked
