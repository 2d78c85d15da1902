"""The covariance filter in Joseph's form."""

import numpy as np

from kalmanhdl.algorithm.gain import normalised_innovation_squared, optimal_gain
from kalmanhdl.algorithm.step import Belief, Outcome, innovation
from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, Condition, named, select
from kalmanhdl.model.state_space import LinearModel


def joseph(model: LinearModel, prior: Belief, z: Array, valid: tuple[Condition, ...]) -> Outcome:
    """Update by P = (I - K H) P (I - K H)' + K R K', liu2007 eq. 4 (Bucy & Joseph, 1968).

    Right for any gain, and a sum of two terms that are positive semidefinite: choose it where the gain
    is coarse or approximate. Multiplications of signals for dense H: about n m (n + m) for the gain, and
    2 n^3 + n^2 m for the covariance.
    """
    y = innovation(model, prior, z, valid)
    gain = optimal_gain(model, prior, valid)
    K = named("update: Kv", _of_valid(gain.K, valid))
    x = named("update: x", prior.x + gain.K @ y)
    A = named("update: A", np.eye(model.n).astype(object) - K @ model.H.astype(object))
    AP = named("update: AP", A @ prior.P)
    KR = named("update: KR", K @ model.R.astype(object))
    P = named("update: P", symmetric(AP @ A.T + KR @ K.T))
    return Outcome(Belief(x, P), y, normalised_innovation_squared(model, gain, y))


def _of_valid(K: Array, valid: tuple[Condition, ...]) -> Array:
    """The gain with a column of zeros for every missed component."""
    masked = K.copy()
    for i, j in np.ndindex(*K.shape):
        masked[i, j] = select(valid[j], K[i, j], 0.0)
    return masked
