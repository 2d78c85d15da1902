"""The gain of the optimal filter, and what can be had from it without a multiplication."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from kalmanhdl.algorithm.filter import Belief
from kalmanhdl.graph.linear_algebra import blocks, inverse, symmetric
from kalmanhdl.graph.signal import Array, Condition, both, is_zero, named, select
from kalmanhdl.model.model import Array as Numbers


class Observation(Protocol):
    """z = H x + v, v ~ N(0, R), of a linear model or of one that is linearised about a state.

    H (m, n) and R (m, m) hold numbers or elements, nis_weight (m,) numbers, or is None.
    """

    @property
    def n(self) -> int:
        """Number of states."""

    @property
    def H(self) -> Any:
        """What the measurements see of the states."""

    @property
    def R(self) -> Any:
        """The covariance of the measurement noise."""

    @property
    def nis_weight(self) -> Numbers | None:
        """The weight of each measurement in the normalised innovation squared."""


@dataclass(frozen=True, slots=True)
class Gain:
    """The optimal gain of one update.

    ``PHt`` and ``K`` are (n, m), ``S_inverse`` (m, m). ``blocks`` are the sets of measurements whose
    innovations are correlated; measurements of different blocks do not see each other. In a block of
    several, ``K`` is zero in the columns of missed components, and ``S_inverse`` is that of the valid
    ones; in a block of one, missing it is left to whoever uses the column.
    """

    PHt: Array
    K: Array
    S_inverse: Array
    blocks: list[list[int]]


def optimal_gain(model: Observation, prior: Belief, valid: tuple[Condition, ...]) -> Gain:
    """K = P H' S^-1 with S = H P H' + R, lee1997 eq. 6.

    A missed component is cut out of S: its row and column keep the diagonal only. Where a measurement
    is a state times a number, and no other measurement is correlated with it, its own row of the gain
    needs no multiplication of signals: H K = I - R S^-1.
    """
    H, R = model.H.astype(object), model.R.astype(object)
    PHt = named("update: PHt", prior.P @ H.T)
    S = named("update: S", symmetric(H @ PHt + R))
    parts = blocks(S)
    for i, j in (pair for part in parts for pair in _pairs(part)):
        S[i, j] = S[j, i] = select(both(valid[i], valid[j]), S[i, j], 0.0)
    if all(len(part) == 1 for part in parts):
        K, S_inverse = _by_division(model, PHt, S)
    else:
        S_inverse = named("update: Si", inverse(S))
        K = PHt @ S_inverse
        for j in (j for part in parts if len(part) > 1 for j in part):
            for i in range(model.n):
                K[i, j] = select(valid[j], K[i, j], 0.0)
    for j, i in direct(model.H).items():
        if [j] in parts:
            K[i, j] = (1.0 - R[j, j] * S_inverse[j, j]) * (1.0 / model.H[j, i])
    return Gain(PHt, named("update: K", K), S_inverse, parts)


def direct(H: Array) -> dict[int, int]:
    """The measurements that are one state times a number, with the state: row j of H to column i.

    A state that several measurements see is left out.
    """
    filled = np.array([[not is_zero(element) for element in row] for row in H])
    once = filled.sum(axis=0) == 1
    rows = {j: np.flatnonzero(row) for j, row in enumerate(filled)}
    alone = {j: int(i[0]) for j, i in rows.items() if len(i) == 1 and once[i[0]]}
    return {j: i for j, i in alone.items() if isinstance(H[j, i], float)}


def normalised_innovation_squared(model: Observation, gain: Gain, y: Array) -> object:
    """y' S^-1 y over the valid components; y is zero for the others.

    Components whose covariances are in different units (``model.nis_weight``) are weighted first.
    """
    weighted = named("update: Siy", gain.S_inverse @ y)
    squares = weighted * y
    return squares.sum() if model.nis_weight is None else squares @ model.nis_weight.astype(object)


def _by_division(model: Observation, PHt: Array, S: Array) -> tuple[Array, Array]:
    """Gain and inverse for a diagonal S: divisions, which share a reciprocal where that pays."""
    n, m = PHt.shape
    K, S_inverse = np.zeros((n, m), object), np.zeros((m, m), object)
    for j in range(m):
        S_inverse[j, j] = 1.0 / S[j, j]
        for i in range(n):
            if not is_zero(PHt[i, j]):
                K[i, j] = PHt[i, j] / S[j, j]
    return K, S_inverse


def _pairs(part: list[int]) -> list[tuple[int, int]]:
    return [(i, j) for k, i in enumerate(part) for j in part[k + 1 :]]
