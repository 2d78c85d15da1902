"""The covariances that a time-invariant model passes when nothing is missed, in double precision."""

from collections.abc import Iterator
from itertools import islice

import numpy as np

from kalmanhdl.model.model import Array
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.validation import InvalidModelValueError

_DOUBLINGS = 64
# Relative to the standard deviations; doublings square the distance, so that the last one is exact.
_SETTLED = 1e-13


def predicted(model: LinearModel, P: Array) -> Array:
    """F P F' + Q, lee1997 eq. 4. Shape (n, n)."""
    result = model.F @ P @ model.F.T + model.Q
    return np.asarray(result + result.T) / 2


def innovation_covariance(model: LinearModel, P: Array) -> Array:
    """S = H P H' + R. Shape (m, m)."""
    return np.asarray(model.H @ P @ model.H.T + model.R)


def optimal_gain(model: LinearModel, P: Array) -> Array:
    """K = P H' S^-1, lee1997 eq. 6. Shape (n, m)."""
    return np.asarray(np.linalg.solve(innovation_covariance(model, P), model.H @ P).T)


def corrected(model: LinearModel, P: Array) -> Array:
    """The covariance after an update, in Joseph's form, liu2007 eq. 4. Shape (n, n)."""
    K = optimal_gain(model, P)
    A = np.eye(model.n) - K @ model.H
    return np.asarray(A @ P @ A.T + K @ model.R @ K.T)


def first_prior(model: LinearModel) -> Array:
    """The covariance that the first update of a track starts from. Shape (n, n)."""
    P = model.initial.P
    return P if model.initial.before_update else predicted(model, P)


def priors(model: LinearModel) -> Iterator[Array]:
    """The a priori covariances of a track from its first update on, for ever."""
    P = first_prior(model)
    while True:
        yield P
        P = predicted(model, corrected(model, P))


def steady_prior(model: LinearModel) -> Array:
    """The a priori covariance that a track of the model comes to. Shape (n, n).

    By doubling the number of steps, 2^64 at most (Anderson & Moore, Optimal Filtering, 1979, chapter 6).
    Raises ModelError where the covariance comes to no rest.
    """
    P = start = first_prior(model)
    information = model.H.T @ np.linalg.solve(model.R, model.H)
    A, G, X = model.F.T, information, model.Q
    unit = np.eye(model.n)
    with np.errstate(all="ignore"):
        for _ in range(_DOUBLINGS):
            before, P = P, X + A.T @ start @ np.linalg.solve(unit + G @ start, A)
            if not np.isfinite(P).all():
                break
            if np.all(np.abs(P - before) <= _SETTLED * (_sizes(before) + _sizes(start))):
                # A few plain steps wash out what doubling left of rounding.
                for _ in range(4):
                    P = predicted(model, corrected(model, P))
                return P
            W = np.linalg.inv(unit + G @ X)
            A, G, X = A @ W @ A, G + A @ W @ G @ A.T, X + A.T @ X @ W @ A
            G, X = (G + G.T) / 2, (X + X.T) / 2
    raise InvalidModelValueError(
        "model", "F", " and H let no covariance come to rest: measure what grows, or leave it out"
    )


def _sizes(P: Array) -> Array:
    deviations = np.sqrt(np.maximum(np.diag(P), 0.0))
    return np.outer(deviations, deviations)


def approach(model: LinearModel, most: int) -> tuple[Array, ...]:
    """The a priori covariances of the first ``most`` updates, fewer once they no longer change."""
    found: list[Array] = []
    for P in islice(priors(model), most):
        if found and np.allclose(P, found[-1], rtol=1e-9, atol=0.0):
            break
        found.append(P)
    return tuple(found)
