"""The covariance filter that takes its measurements one after the other."""

from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from typing import Any, ClassVar

import numpy as np

from kalmanhdl.algorithm.covariance import corrected, covariance_filter, innovation
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given
from kalmanhdl.algorithm.varying import of_linear
from kalmanhdl.graph.linear_algebra import blocks, quotient, symmetric, times, vector
from kalmanhdl.graph.signal import Array, Condition, Scalar, named, named_at, select
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel


@dataclass(frozen=True, slots=True)
class Sequential(Algorithm):
    """Update by one scalar measurement after the other: m reciprocals and no inverse.

    lee1997 eq. 6 to 8 with one row of H at a time (Grewal & Andrews, Kalman Filtering: serial processing of
    uncorrelated measurements). Each component sees the belief that the components before it left. Where R
    correlates components, decorrelating them once for all would be wrong as soon as one of them is missed;
    instead each one used conditions the remaining ones of its block: with c = Cov(x, z_j) and s = Var(z_j),
    after it for every later i and k

        Cov(x, z_i) -= c Cov(z_j, z_i) / s,   Cov(z_i, z_k) -= Cov(z_i, z_j) Cov(z_j, z_k) / s,

    and a missed one conditions nothing, which is the update by those that are valid, whatever they are.

    Multiplications of signals for dense H: m (n (n + 1) / 2 + 2 n), and n + 2 or more for each pair of
    components that R correlates. Choose it where H P H' + R is full: it costs less than Conventional and
    is longer from input to output, by m reciprocals in a row instead of one factorisation.
    """

    kind: ClassVar[str] = "sequential"

    def __call__(self, model: Model) -> Filter:
        """The filter of a linear model, or of one that varies."""
        return of_linear(model, self, _filter)


def _filter(linear: LinearModel) -> Filter:
    return covariance_filter(linear, lambda prior, given: _update(linear, prior, given))


def _update(model: LinearModel, prior: Belief, given: Given) -> Correction:
    y = innovation(model, prior.x, given)
    dx, P = np.zeros(model.n, object), prior.P
    nis: Any = 0.0
    K, passed = np.zeros((model.n, model.m), object), list[tuple[int, Array]]()
    for part in blocks(model.R):
        H, R = model.H[part].astype(object), model.R[np.ix_(part, part)].astype(object)
        PHt = P @ H.T
        unused = _Unused(PHt, symmetric(H @ PHt + R), y[part] - H @ dx)
        _name(part, unused)
        for a, j in enumerate(part):
            c, s = unused.PHt[:, a], unused.S[a, a]
            e = select(given.valid[j], unused.residual[a], 0.0)
            named_at(f"update_{j}: y", (j,), e)
            K[:, j] = _gain(model, part, c, s)
            P = _reduced(model, part, j, P, c, K[:, j], given.valid[j])
            dx = dx + times(K[:, j], e)
            nis = nis + _square(model, j, e, s)
            unused = _conditioned(unused, a, e, given.valid[j])
        passed.append((part[-1], P))
    correction = corrected(prior.x + dx, P, y, nis)
    named("update: K", K)
    # What the last component leaves has its name by now; these are what it was made from.
    for j, P in passed:
        named(f"update_{j}: P", P)
    return correction


@dataclass(frozen=True, slots=True)
class _Unused:
    """The components of a block given those used: Cov(x, z) (n, b), Cov(z) (b, b) and z - E z (b,)."""

    PHt: Array
    S: Array
    residual: Array


def _conditioned(unused: _Unused, a: int, e: Scalar, valid: Condition) -> _Unused:
    """The components behind the a-th given that one, whose error is e, if it is valid."""
    PHt, S, residual = unused.PHt.copy(), unused.S.copy(), unused.residual.copy()
    for i in range(a + 1, len(S)):
        weight = select(valid, quotient(S[a, i], S[a, a]), 0.0)
        PHt[:, i] = PHt[:, i] - times(PHt[:, a], weight)
        residual[i] = residual[i] - weight * e
        for k in range(i, len(S)):
            S[i, k] = S[k, i] = S[i, k] - weight * unused.S[a, k]
    return _Unused(PHt, S, residual)


def _gain(model: LinearModel, part: list[int], c: Array, s: Scalar) -> Array:
    """c / s; a state measured directly needs no multiplication of signals: H K = 1 - R / s."""
    gain = vector(quotient(element, s) for element in c)
    for j, i in _direct(model, part).items():
        gain[i] = (1.0 - model.R[j, j] * (1.0 / s)) * (1.0 / model.H[j, i])
    return gain


def _reduced(
    model: LinearModel, part: list[int], j: int, P: Array, c: Array, gain: Array, valid: Condition
) -> Array:
    """P - c c' / s where the component is valid; the column of a state measured directly is K R / h."""
    used = vector(select(valid, element, 0.0) for element in gain)
    for i, element in enumerate(used):
        named_at("update: Kv", (i, j), element)
    reduced = P - np.outer(used, c)
    for i in _direct(model, part).values():
        ratio = model.R[j, j] / model.H[j, i]
        for k in range(model.n):
            reduced[i, k] = reduced[k, i] = select(valid, gain[k] * ratio, P[k, i])
    return symmetric(reduced)


def _direct(model: LinearModel, part: list[int]) -> dict[int, int]:
    """A component that is one state times a number, with the state, if R correlates it with no other."""
    seen = np.flatnonzero(model.H[part[0]])
    return {part[0]: int(seen[0])} if len(part) == len(seen) == 1 else {}


def _square(model: LinearModel, j: int, e: Scalar, s: Scalar) -> Scalar:
    square = (1.0 / s * e) * e
    return square if model.nis_weight is None else square * model.nis_weight[j]


def _name(part: list[int], unused: _Unused) -> None:
    """Name the covariances of a block by the measurements that they are of."""
    for (a, j), (b, k) in combinations_with_replacement(enumerate(part), 2):
        named_at("update: S", (j, k), unused.S[a, b])
    for i, (a, j) in product(range(len(unused.PHt)), enumerate(part)):
        named_at("update: PHt", (i, j), unused.PHt[i, a])
