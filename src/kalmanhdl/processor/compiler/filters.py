"""Filters on whole matrices: each a function of matrices and vectors, which traces it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from kalmanhdl.algorithm import Algorithm, Conventional, Joseph, Sequential, Taylor, steady_state
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.graph import Matrix, named
from kalmanhdl.processor.instructions import Opcode

Anything = Any
"""A traced matrix or vector."""

MAX_INVERSE = 3
_OTHER = 'use "sequential"'


@dataclass(frozen=True, slots=True, kw_only=True)
class Matrices:
    """The matrices of a model as constants. ``c(name, values)`` makes a further one."""

    model: LinearModel
    c: Callable[[str, Any], Anything]

    def __getattr__(self, name: str) -> Anything:
        return self.c(name, getattr(self.model, name))


Update = Callable[[Matrices, Anything, Anything, Anything, Anything], tuple[Anything, Anything]]
"""From the a priori x and P, the measurement z and the diagonal V of its valid flags to the new x and P."""


def predict(model: Matrices, x: Anything, P: Anything) -> tuple[Anything, Anything]:
    """F x and F P F' + Q."""
    x = named(model.F @ x, "predict: x")
    if np.any(model.model.offset):
        x = named(x + model.offset, "predict: x with its offset")
    return x, named(named(model.F @ P, "predict: F P") @ model.F.T + model.Q, "predict: P")


def update_of(algorithm: Algorithm, model: LinearModel, size: int) -> Update:
    """The update of an algorithm. Raises ProgramError for one that has no program yet."""
    match algorithm:
        case Conventional():
            return lambda m, x, P, z, V: _gained(m, x, P, z, V, _inverted(m, size), joseph=False)
        case Joseph():
            return lambda m, x, P, z, V: _gained(m, x, P, z, V, _inverted(m, size), joseph=True)
        case Taylor():
            if algorithm.newton:
                raise ProgramError(
                    f"[algorithm] newton = {algorithm.newton}: programs have none yet: leave it out"
                )
            if model.m > 1:
                # Which inverse is expanded depends on which measurements are valid.
                raise ProgramError(
                    f'[algorithm] "taylor" has programs for one measurement, not {model.m}: {_OTHER}'
                )
            S0 = steady_state.innovation_covariance(model, algorithm.point(model))
            X0 = np.linalg.inv(S0)
            return lambda m, x, P, z, V: _gained(m, x, P, z, V, _expanded(m, X0), joseph=True)
        case Sequential():
            return _sequential
        case _:
            kinds = "conventional, joseph, sequential or taylor"
            raise ProgramError(f'[algorithm] kind = "{algorithm.kind}" has no program: choose {kinds}')


def _gained(
    model: Matrices,
    x: Anything,
    P: Anything,
    z: Anything,
    V: Anything,
    by_inverse: Callable[[Anything, Anything], Anything],
    *,
    joseph: bool,
) -> tuple[Anything, Anything]:
    """An update by a gain; a missed measurement has a row of zeros in V H, and so a column of zeros in K."""
    H = named(V @ model.H, "update: H of what is valid")
    PHt = named(P @ H.T, "update: P H'")
    S = named(named(H @ PHt, "update: H P H'") + _noise(model, V), "update: S")
    K = named(by_inverse(PHt, S), "update: K")
    y = named(_measured(model, z) - named(H @ x, "update: H x"), "update: y")
    x = named(x + named(K @ y, "update: K y"), "update: x")
    if not joseph:
        return x, _symmetric(named(P - named(K @ PHt.T, "update: K H P"), "update: P"))
    A = named(model.c("I", np.eye(model.model.n)) - named(K @ H, "update: K H"), "update: I - K H")
    first = named(named(A @ P, "update: A P") @ A.T, "update: A P A'")
    return x, named(first + named(named(K @ model.R, "update: K R") @ K.T, "update: K R K'"), "update: P")


def _noise(model: Matrices, V: Anything) -> Anything:
    """R; where it is no diagonal, V R V + I - V, so that a missed measurement has no part in the others."""
    R = model.model.R
    if not np.any(R - np.diag(np.diag(R))):
        return model.R
    valid = named(named(V @ model.R, "update: V R") @ V.T, "update: V R V")
    missed = named(model.c("I_m", np.eye(len(R))) - V, "update: I - V")
    return named(valid + missed, "update: R of what is valid")


def _symmetric(P: Matrix) -> Anything:
    """(P + P') / 2. Rounding costs P its symmetry, and nothing in P - K H P takes what is odd away again."""
    return named((P + P.transposed()).shifted(-1), "update: P, even")


def _measured(model: Matrices, z: Anything) -> Anything:
    """A measurement without its offset."""
    if not np.any(model.model.measurement_offset):
        return z
    return named(z - model.measurement_offset, "update: z without its offset")


def _inverted(model: Matrices, size: int) -> Callable[[Anything, Anything], Anything]:
    """P H' S^-1 by a reciprocal where S is a number, by adjugate and determinant where it is larger."""
    m = model.model.m
    if m > 1 and (m > MAX_INVERSE or size != MAX_INVERSE):
        raise ProgramError(f"[algorithm] {m} measurements at once need matrices of 3 by 3: {_OTHER}")

    def by_inverse(PHt: Anything, S: Anything) -> Anything:
        if m == 1:
            return PHt.scaled(named(S.alone(Opcode.RECIP, (1, 1)), "update: 1 / S"))
        return PHt @ _inverse(S, model, size)

    return by_inverse


def _inverse(S: Matrix, model: Matrices, size: int) -> Anything:
    """By adjugate and determinant. S is brought near one first, where both have the most digits."""
    exponent = -_exponent(model.model)
    m = model.model.m
    rest = np.diag([0.0] * m + [1.0] * (size - m))
    whole = S.shifted(exponent)
    if m < size:
        whole = whole + model.c("rest", rest)
    named(whole, "update: S near one")
    adjugate = named(whole.alone(Opcode.ADJ_33, (size, size)), "update: adj S")
    determinant = named(whole.alone(Opcode.DET_33, (1, 1)), "update: det S")
    divisor = named(determinant.alone(Opcode.RECIP, (1, 1)), "update: 1 / det S")
    inverse = adjugate.scaled(divisor).shifted(exponent)
    return named(inverse, "update: S^-1")


def _exponent(model: LinearModel) -> int:
    """The power of two nearest to the root of the product of the innovations' variances, as they settle."""
    S = steady_state.innovation_covariance(model, steady_state.steady_prior(model))
    return round(float(np.log2(np.linalg.det(S))) / model.m)


def _expanded(model: Matrices, X0: Any) -> Callable[[Anything, Anything], Anything]:
    """P H' (2 X0 - X0 S X0), liu2007 eq. 14 and 15."""

    def by_inverse(PHt: Anything, S: Anything) -> Anything:
        X = model.c("X0", X0)
        product = named(named(X @ S, "update: X0 S") @ X, "update: X0 S X0")
        return PHt @ named(model.c("X0_2", 2.0 * X0) - product, "update: S^-1")

    return by_inverse


def _sequential(
    model: Matrices, x: Anything, P: Anything, z: Anything, V: Anything
) -> tuple[Anything, Anything]:
    """A scalar update for each measurement. Raises ProgramError where they are correlated."""
    linear = model.model
    if np.any(linear.R - np.diag(np.diag(linear.R))):
        raise ProgramError('[algorithm] "sequential" needs a diagonal R here: use "conventional"')
    z = _measured(model, z)
    for j in range(linear.m):
        only = np.diag(np.eye(linear.m)[j])
        h = named(V @ model.c(f"H{j}", only @ linear.H), f"update {j}: h, if valid")
        Ph = named(P @ h.T, f"update {j}: P h'")
        S = named(named(h @ Ph, f"update {j}: h P h'") + model.c(f"R{j}", only @ linear.R), f"update {j}: s")
        K = named(_over(Ph, S, j), f"update {j}: K")
        y = named(z - named(h @ x, f"update {j}: h x"), f"update {j}: y")
        x = named(x + named(K @ y, f"update {j}: K y"), f"update {j}: x")
        P = named(P - named(K @ Ph.T, f"update {j}: K h P"), f"update {j}: P")
    return x, _symmetric(P)


def _over(Ph: Anything, S: Anything, j: int) -> Anything:
    """P h' / s, s being element j, j of S."""
    s = S if j == 0 else named(S.picked(j), f"update {j}: s alone")
    return Ph.scaled(named(s.alone(Opcode.RECIP, (1, 1)), f"update {j}: 1 / s"))
