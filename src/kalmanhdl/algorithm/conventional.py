"""The conventional covariance filter."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kalmanhdl.algorithm.covariance import corrected, covariance_filter, innovation
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given
from kalmanhdl.algorithm.gain import Gain, Observation, direct, normalised_innovation_squared, optimal_gain
from kalmanhdl.algorithm.varying import of_linear
from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, Condition, select
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel


@dataclass(frozen=True, slots=True)
class Conventional(Algorithm):
    """Update by P = (I - K H) P, lee1997 eq. 6 to 8.

    The cheapest form. Rounding can cost P its symmetry, which is kept by computing one triangle, and its
    definiteness, which is not: choose Joseph where P spans many orders of magnitude. Multiplications of
    signals for dense H: about n m (n + m) + n (n + 1) m / 2 + m^3 / 3, and m reciprocals; the prediction of P
    takes about n^2 (3 n + 1) / 2 by constants for dense F.
    """

    kind: ClassVar[str] = "conventional"

    def __call__(self, model: Model) -> Filter:
        """The filter of a linear model, or of one that varies."""
        return of_linear(model, self, _filter)


def _filter(linear: LinearModel) -> Filter:
    return covariance_filter(linear, lambda prior, given: conventional_update(linear, prior, given))


def conventional_update(model: LinearModel, prior: Belief, given: Given) -> Correction:
    y = innovation(model, prior.x, given)
    return conventional_correction(model, prior, given.valid, y)


def conventional_correction(
    model: Observation, prior: Belief, valid: tuple[Condition, ...], y: Array
) -> Correction:
    """The update by an innovation y (m,), zero where a component is missed."""
    gain = optimal_gain(model, prior, valid)
    P = symmetric(_covariance(model, prior, gain, valid))
    return corrected(prior.x + gain.K @ y, P, y, normalised_innovation_squared(model, gain, y))


def _covariance(model: Observation, prior: Belief, gain: Gain, valid: tuple[Condition, ...]) -> Array:
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
            factor = model.R[j, j] / model.H[j, i]
            for k in range(model.n):
                reduced[k, i] = reduced[i, k] = gain.K[k, j] * factor
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
