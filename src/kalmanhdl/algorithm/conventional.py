"""The conventional covariance filter."""

import numpy as np

from kalmanhdl.algorithm.gain import Gain, direct, normalised_innovation_squared, optimal_gain
from kalmanhdl.algorithm.step import Belief, Outcome, innovation
from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, Condition, named, select
from kalmanhdl.model.state_space import LinearModel


def conventional(model: LinearModel, prior: Belief, z: Array, valid: tuple[Condition, ...]) -> Outcome:
    """Update by P = (I - K H) P, lee1997 eq. 6 to 8.

    The cheapest form. Rounding can cost P its symmetry, which is kept by computing one triangle, and its
    definiteness, which is not: choose Joseph where P spans many orders of magnitude. Multiplications of
    signals for dense H: about n m (n + m) + n (n + 1) m / 2 + m^3 / 3, and m reciprocals.
    """
    y = innovation(model, prior, z, valid)
    gain = optimal_gain(model, prior, valid)
    x = named("update: x", prior.x + gain.K @ y)
    P = named("update: P", symmetric(_covariance(model, prior, gain, valid)))
    return Outcome(Belief(x, P), y, normalised_innovation_squared(model, gain, y))


def _covariance(model: LinearModel, prior: Belief, gain: Gain, valid: tuple[Condition, ...]) -> Array:
    """P - K H P, block by block; a column that H measures directly is K R, since P H' = K R after it."""
    P = prior.P.copy()
    measured = direct(model.H)
    for part in gain.blocks:
        reduced = P - gain.K[:, part] @ gain.PHt[:, part].T
        if len(part) > 1:
            P = reduced
            continue
        (j,) = part
        if j in measured:
            i = measured[j]
            column = gain.K[:, j] * (model.R[j, j] / model.H[j, i])
            reduced[:, i] = reduced[i, :] = column
        touched = [
            [not _same(a, b) for a, b in zip(*rows, strict=True)] for rows in zip(reduced, P, strict=True)
        ]
        for place in np.argwhere(touched):
            k, h = place
            P[k, h] = select(valid[j], reduced[k, h], P[k, h])
    return P


def _same(a: object, b: object) -> bool:
    index = getattr(a, "index", None)
    return index is not None and index == getattr(b, "index", None)
