"""The double-precision reference: the algorithm itself, run on floats."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.step import Belief, Given, Update, step
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.simulate.commands import Command

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimates:
    """What a filter put out, in the model's units; NaN where a row is no step.

    x (steps, tracks, n), P (steps, tracks, n, n), innovation (steps, tracks, m), nis (steps, tracks).
    """

    x: Array
    P: Array
    innovation: Array
    nis: Array


def reference(model: LinearModel, update: Update, given: NDArray[np.int8], z: Array, u: Array) -> Estimates:
    """The estimates of an algorithm in double precision.

    Shapes: commands ``given`` (steps, tracks), z (steps, tracks, m) with NaN where missed,
    u (steps, tracks, p).
    """
    steps, tracks, m = z.shape
    n = model.n
    belief = _spread(np.zeros(n), np.zeros((n, n)), tracks)
    x, P = np.full((steps, tracks, n), np.nan), np.full((steps, tracks, n, n), np.nan)
    innovation, nis = np.full((steps, tracks, m), np.nan), np.full((steps, tracks), np.nan)
    for k in range(steps):
        acts = given[k] != Command.NONE
        outcome = step(model, update, belief, _data(z[k], u[k], given[k]))
        new_x, new_P = _array(outcome.belief.x, tracks), _array(outcome.belief.P, tracks)
        old_x, old_P = _array(belief.x, tracks), _array(belief.P, tracks)
        kept_x = np.where(acts[:, None], new_x, old_x)
        kept_P = np.where(acts[:, None, None], new_P, old_P)
        belief = _split(kept_x, kept_P)
        x[k, acts], P[k, acts] = new_x[acts], new_P[acts]
        innovation[k, acts] = _array(outcome.innovation, tracks)[acts]
        nis[k, acts] = np.broadcast_to(np.asarray(outcome.nis, float), tracks)[acts]
    return Estimates(x=x, P=P, innovation=innovation, nis=nis)


def _data(z: Array, u: Array, given: NDArray[np.int8]) -> Given:
    seen = ~np.isnan(z) & (given != Command.PREDICT)[:, None]
    filled = np.nan_to_num(z)
    return Given(
        z=_objects(filled),
        valid=tuple(seen.T),
        u=_objects(u),
        initialise=given == Command.INITIALISE,
    )


def _objects(rows: Array) -> NDArray[Any]:
    """(tracks, k) to k elements that are arrays over tracks."""
    result = np.empty(rows.shape[1], object)
    for element, column in enumerate(rows.T):
        result[element] = column
    return result


def _spread(x: Array, P: Array, tracks: int) -> Belief:
    return _split(np.broadcast_to(x, (tracks, *x.shape)), np.broadcast_to(P, (tracks, *P.shape)))


def _split(x: Array, P: Array) -> Belief:
    n = x.shape[1]
    covariance = np.empty((n, n), object)
    for i, j in np.ndindex(n, n):
        covariance[i, j] = P[:, i, j]
    return Belief(_objects(x), covariance)


def _array(elements: NDArray[Any], tracks: int) -> Array:
    """Elements, floats or arrays over tracks, as one array with the tracks in front."""
    result = np.empty((tracks, *elements.shape))
    for place in np.ndindex(*elements.shape):
        result[(slice(None), *place)] = elements[place]
    return result
