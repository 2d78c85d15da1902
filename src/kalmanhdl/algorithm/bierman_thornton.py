"""The filter that keeps the factors of the covariance: P = U D U'."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from kalmanhdl.algorithm.covariance import innovation, predict_mean, start_mean
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given
from kalmanhdl.algorithm.memory import Kept, Kind, Memory
from kalmanhdl.algorithm.varying import of_linear
from kalmanhdl.graph.elements import elements
from kalmanhdl.graph.linear_algebra import blocks, quotient, symmetric, times, vector
from kalmanhdl.graph.signal import Array, Condition, Scalar, is_zero, named, named_at, negative, select
from kalmanhdl.model.inputs import points
from kalmanhdl.model.model import Array as Numbers
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.model.varying import VaryingModel
from kalmanhdl.validation import InvalidModelValueError

# What a factorisation leaves of a singular covariance, relative to its variances.
_ROUNDING = 64 * np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True)
class BiermanThornton(Algorithm):
    """U unit upper triangular and D diagonal in place of P; liu2007 section 4.1.

    Measurement update: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapter V,
    one scalar after the other. Time update: Thornton's modified weighted Gram-Schmidt, 1976; Bierman 1977,
    chapter VI. P can lose neither symmetry nor definiteness, whatever the rounding, and half of the
    digits of P suffice: choose it where P spans many orders of magnitude or R is small beside H P H'.

    Where R correlates components, their errors v stand before x as states of their own, with the factors
    of R: the first component is then measured with the error that the later ones leave of it, and whether
    it is used or missed, striking its error out is striking out the first row of U. That needs no
    decorrelation that a missed component could spoil.

    Q and the start may be singular: zeros of their D are left out. A variance of D that vanishes while
    running divides nothing. Zeros of U stay where parts of the model are decoupled, in any order of states.

    With run-time inputs F may vary, and so may Q, R and the P of the start: their diagonals as they are, what
    they correlate by factors that every step computes, a reciprocal for each but one of what belongs
    together. Such a Q or P must be definite for all inputs.

    Multiplications of signals for dense F and H: about m (n^2 + 5 n) for measurements and 0.6 n (n + 1)
    (n + q) for time, where q is the rank of Q, and n (n - 1) for the variances put out; m n + n - 1
    reciprocals.
    """

    kind: ClassVar[str] = "bierman_thornton"

    def __call__(self, model: Model) -> Filter:
        """The filter of a linear model, or of one that varies. Raises ModelError where a covariance that
        varies has no factors."""
        if isinstance(model, VaryingModel):
            _check_factors(model, self)
            # Which variances vanish follows from the inputs: any may.
            anywhere = frozenset(range(model.n))
            return of_linear(model, self, lambda linear: _filter(linear, anywhere))
        return of_linear(model, self, lambda linear: _filter(linear, vanishing_variances(linear)))


def _filter(linear: LinearModel, vanishing: frozenset[int]) -> Filter:
    n, initial = linear.n, linear.initial
    U, D = _factored(initial.P)
    noise = _factored(linear.Q)
    return Filter(
        kept=(
            Kept("x", Kind.STATE, (n,)),
            Kept("U", Kind.FACTOR, (n, n)),
            Kept("D", Kind.VARIANCE, (n,)),
        ),
        start=lambda memory, given: {"x": start_mean(linear, memory["x"], given), "U": U, "D": D},
        predict=lambda memory, given: _predicted(linear, noise, vanishing, memory, given),
        update=lambda memory, given: _updated(linear, memory, given),
        estimate=lambda memory: Belief(memory["x"], _covariance(memory["U"], memory["D"])),
        before_update=initial.before_update,
    )


def _check_factors(model: VaryingModel, algorithm: Algorithm) -> None:
    """Raises ModelError where elements that vary correlate what may be certain: it has no factors."""
    us = points(model.inputs, model.p)
    steps = [model.at(elements(u)) for u in us]
    for key, matrices in (
        ("model.Q", [step.Q for step in steps]),
        ("model.initial.P", [step.initial.P for step in steps]),
    ):
        found = np.array([np.asarray(matrix, float) for matrix in matrices])
        for block in blocks(found.any(axis=0).astype(float)):
            part = found[:, block][:, :, block]
            singular = any((factors(each)[1] == 0.0).any() for each in part)
            if len(block) > 1 and singular and (part != part[0]).any():
                instead = "use one that is definite, or diagonal, or another algorithm"
                names = ", ".join(model.state_names[k] for k in block)
                problem = f' = "{algorithm.kind}" keeps factors, and {key} of {names} varies and is singular'
                raise InvalidModelValueError("algorithm", "kind", f"{problem}: {instead}")


def _factored(P: Array) -> tuple[Array, Array]:
    """U (n, n) and D (n,) with P = U D U' of numbers, or of elements where P varies, block by block."""
    U, D = np.eye(len(P)).astype(object), np.zeros(len(P), object)
    for block in blocks(P):
        part = P[np.ix_(block, block)]
        fixed = all(isinstance(element, float) for element in part.ravel().tolist())
        found = factors(part.astype(float)) if fixed else _factors_of_elements(part)
        U[np.ix_(block, block)], D[block] = found
    return U, D


def _factors_of_elements(P: Array) -> tuple[Array, Array]:
    """As ``factors``, of a definite P (n, n) whose elements vary: a reciprocal for each but the first row."""
    n, rest = len(P), P.copy()
    U, D = np.eye(n).astype(object), np.zeros(n, object)
    for j in range(n - 1, -1, -1):
        D[j] = rest[j, j]
        for i in range(j):
            U[i, j] = quotient(rest[i, j], D[j])
        for i in range(j):
            for k in range(i, j):
                rest[i, k] = rest[k, i] = rest[i, k] - U[i, j] * rest[k, j]
    return U, D


def factors(P: Numbers) -> tuple[Numbers, Numbers]:
    """U unit upper triangular (n, n) and D >= 0 (n,) with P = U D U'; P (n, n) may be singular.

    Bierman 1977, chapter III. What is nothing but rounding beside the variances of P is zero.
    """
    n, rest = len(P), P.copy()
    U, D = np.eye(n), np.zeros(n)
    size = np.sqrt(np.maximum(np.outer(np.diag(P), np.diag(P)), 0.0))
    for j in range(n - 1, -1, -1):
        nothing = np.all(np.abs(rest[:j, j]) <= _ROUNDING * size[:j, j])
        if rest[j, j] > (_ROUNDING * size[j, j] if nothing else 0.0):
            D[j] = rest[j, j]
            U[:j, j] = rest[:j, j] / D[j]
            rest[:j, :j] -= D[j] * np.outer(U[:j, j], U[:j, j])
    return U, D


def vanishing_variances(model: LinearModel) -> frozenset[int]:
    """The variances of D that become zero while the track runs, though not for ever.

    Updates leave the range of P as it is, since R is definite: predictions alone tell.
    """
    found, noise = set[int](), factors(model.Q)
    U, D = factors(model.initial.P)
    for _ in range(2 * model.n + 2):
        U, D = factors(model.F @ (U * D) @ U.T @ model.F.T + (noise[0] * noise[1]) @ noise[0].T)
        found |= set(np.flatnonzero(D == 0.0).tolist())
    return frozenset(found)


def _predicted(
    model: LinearModel,
    noise: tuple[Array, Array],
    vanishing: frozenset[int],
    memory: Memory,
    given: Given,
) -> Memory:
    """Thornton: the rows of [F U, G] made orthogonal under the weights of D and Q = G Dq G'."""
    n, used = model.n, [k for k, variance in enumerate(noise[1]) if not is_zero(variance)]
    W = np.hstack([model.F.astype(object) @ memory["U"], noise[0][:, used]])
    weights = np.concatenate([memory["D"], noise[1][used]])
    U, D = np.eye(n).astype(object), np.zeros(n, object)
    for j in range(n - 1, -1, -1):
        weighted = weights * W[j]
        D[j] = W[j] @ weighted
        if is_zero(D[j]):
            continue
        named_at("predict: D", (j,), D[j])
        # Where it vanishes, so does what it divides.
        divisor = select(negative(-D[j]), D[j], 1.0) if j in vanishing else D[j]
        for i in range(j):
            U[i, j] = quotient(W[i] @ weighted, divisor)
            named_at("predict: U", (i, j), U[i, j])
            W[i] = W[i] - times(W[j], U[i, j])
    return {"x": predict_mean(model, memory["x"], given), "U": U, "D": D}


@dataclass(frozen=True, slots=True)
class _Joint:
    """Errors v of measurements and x after them: mean changes d, U and D of both together."""

    d: Array
    U: Array
    D: Array


def _updated(model: LinearModel, memory: Memory, given: Given) -> Correction:
    x, n = memory["x"], model.n
    y = innovation(model, x, given)
    state = _Joint(np.zeros(n, object), memory["U"], memory["D"])
    nis: Any = 0.0
    passed = list[tuple[int, _Joint]]()
    for part in blocks(model.R):
        joint = _with_errors(model, part, state)
        for a, j in enumerate(part):
            h = np.concatenate([np.zeros(len(part) - a - 1), model.H[j]]).astype(object)
            e = select(given.valid[j], y[j] - joint.d[0] - h @ joint.d[1:], 0.0)
            named_at(f"update_{j}: y", (j,), e)
            joint, square = _measured(joint, h, e, given.valid[j], j, n)
            nis = nis + (square if model.nis_weight is None else square * model.nis_weight[j])
        state = joint
        passed.append((part[-1], state))
    after = {"x": named("update: x", x + state.d), "U": named("update: U", state.U), "D": state.D}
    named("update: D", state.D)
    # What the last component leaves has its name by now; these are what it was made from.
    for j, before in passed:
        named(f"update_{j}: U", before.U)
        named(f"update_{j}: D", before.D)
    return Correction(after, y, nis)


def _with_errors(model: LinearModel, part: list[int], state: _Joint) -> _Joint:
    """The errors of a block of measurements, and x behind them."""
    UR, DR = _factored(model.R[np.ix_(part, part)])
    b, n = len(part), model.n
    U = np.zeros((b + n, b + n), object)
    U[:b, :b], U[b:, b:] = UR, state.U
    return _Joint(np.concatenate([np.zeros(b), state.d]), U, np.concatenate([DR, state.D]))


def _measured(joint: _Joint, h: Array, e: Scalar, valid: Condition, j: int, n: int) -> tuple[_Joint, Any]:
    """Bierman: z = v + h s, where v is the first error and s, that ends with x (n,), what stands behind it.

    Returns what is known of s, and e^2 over the variance of e; e is zero if z, the j-th, is missed.
    """
    size = len(h)
    # v weighs in by its correlation with s as well: by its row of U.
    f = joint.U[0, 1:] + h @ joint.U[1:, 1:]
    U, D = joint.U[1:, 1:].copy(), joint.D[1:].copy()
    g = D * f
    alpha, k = joint.D[0], np.zeros(size, object)
    for c in range(size):
        if is_zero(f[c]) or is_zero(g[c]):
            continue
        before, alpha = alpha, alpha + f[c] * g[c]
        lambda_ = select(valid, quotient(f[c], before), 0.0)
        D[c] = select(valid, D[c] * (before / alpha), D[c])
        for i in range(c):
            U[i, c], k[i] = U[i, c] - lambda_ * k[i], k[i] + g[c] * U[i, c]
        k[c] = g[c]
    named_at("update: S", (j, j), alpha)
    weighted = 1.0 / alpha * e
    gain = vector(quotient(element, alpha) for element in k)
    for i, element in enumerate(gain[size - n :]):
        named_at("update: K", (i, j), element)
    return _Joint(joint.d[1:] + times(gain, e), U, D), weighted * e


def _covariance(U: Array, D: Array) -> Array:
    n = len(D)
    P = np.zeros((n, n), object)
    weighted = U * D
    for i in range(n):
        for j in range(i, n):
            P[i, j] = U[i, j:] @ weighted[j, j:]
    return symmetric(P)
