"""Filters that keep the covariance, on whole matrices."""

from collections.abc import Callable
from typing import Any

import numpy as np

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.compiler.graph import named
from kalmanhdl.processor.compiler.recipe import (
    Anything,
    Given,
    Kept,
    Matrices,
    Recipe,
    measured,
    near_one,
    predicted_mean,
)
from kalmanhdl.processor.instructions import Opcode

ADJUGATE = 3
"""The size of the matrices whose inverse is found by adjugate and determinant."""

Update = Callable[[Matrices, Anything, Anything, Anything, Anything], tuple[Anything, Anything]]
"""From the a priori x and P, the measurement z and the diagonal V of its valid flags to the new x and P."""


def keeping_covariance(update: Update) -> Recipe:
    """The filter with an update."""

    def updated(m: Matrices, kept: Kept, given: Given) -> Kept:
        x, P = update(m, kept["x"], kept["P"], given.z, given.V)
        return {"x": x, "P": P}

    return Recipe(
        vectors=("x",),
        matrices=("P",),
        begin=lambda m: {"P": m.c("P0", m.model.initial.P)},
        predict=_predicted,
        update=updated,
        finish=lambda m, kept: kept,
        variances="P",
        covariance=lambda values: values["P"],
    )


def _predicted(m: Matrices, kept: Kept, given: Given) -> Kept:
    """F x and F P F' + Q."""
    FP = named(m.F @ kept["P"], "predict: F P")
    return {"x": predicted_mean(m, kept["x"], given), "P": named(m.Q.plus(FP, m.F), "predict: P")}


def gained(
    model: Matrices,
    x: Anything,
    P: Anything,
    z: Anything,
    V: Anything,
    by_inverse: Callable[[Anything, Anything], Anything],
    *,
    joseph: bool,
) -> tuple[Anything, Anything]:
    """An update by a gain; a missed measurement has a row of zeros in V H, and so a column of zeros in K.

    Measurements are taken in units in which S is near one, where it and its inverse have the most digits.
    """
    D = near_one(model.model)
    H = named(model.c("H_D", D @ model.model.H).rows_where(V), "update: H of what is valid")
    HP = named(H @ P, "update: H P")
    PHt = named(HP.transposed(), "update: P H'")
    S = named(_noise(model, V, D).plus(HP, H), "update: S")
    K = named(by_inverse(PHt, S), "update: K")
    y = named(measured(model, z).minus(model.H, x), "update: y")
    y = named(model.c("D", D) @ y, "update: y in its units")
    x = named(x.plus(K, y), "update: x")
    if not joseph:
        return x, named(P.minus(K, PHt), "update: P")
    A = named(model.c("I", np.eye(model.model.n)) - named(K @ H, "update: K H"), "update: I - K H")
    KR = named(K @ model.c("R_D", D @ model.model.R @ D), "update: K R")
    noise = named(KR @ K.T, "update: K R K'")
    return x, named(noise.plus(named(A @ P, "update: A P"), A), "update: P")


def _noise(model: Matrices, V: Anything, D: Any) -> Anything:
    """R in its units, and one on the rest of the diagonal, so that S is a matrix of the core with an inverse.

    Where R is no diagonal it is V R V + I - V, so that a missed measurement has no part in the others.
    """
    R, size = D @ model.model.R @ D, V.builder.size
    if not np.any(R - np.diag(np.diag(R))):
        whole = np.eye(size)
        whole[: len(R), : len(R)] = R
        return model.c("R_D", whole)
    rows = named(model.c("R_D", R).rows_where(V), "update: V R")
    valid = named(named(rows.transposed(), "update: R V").rows_where(V), "update: V R V")
    missed = named(model.c("I", np.eye(size)) - V, "update: I - V")
    return named(valid + missed, "update: R of what is valid")


def inverted(model: Matrices, size: int) -> Callable[[Anything, Anything], Anything]:
    """P H' S^-1 by a reciprocal where S is a number, by adjugate and determinant, or by sweeps."""
    m = model.model.m

    def by_inverse(PHt: Anything, S: Anything) -> Anything:
        if m == 1:
            return PHt.scaled(named(S.alone(Opcode.RECIP, (1, 1)), "update: 1 / S"))
        if m > ADJUGATE or size != ADJUGATE:
            return PHt @ _swept(model, S)
        determinant = named(S.alone(Opcode.DET_33, (1, 1)), "update: det S")
        divisor = named(determinant.alone(Opcode.RECIP, (1, 1)), "update: 1 / det S")
        adjugate = named(S.alone(Opcode.ADJ_33, (size, size)), "update: adj S")
        # The product goes on while the reciprocal is found.
        return named(PHt @ adjugate, "update: P H' adj S").scaled(divisor)

    return by_inverse


def _swept(model: Matrices, S: Anything) -> Anything:
    """S^-1 by a sweep of every diagonal element (Goodnight 1979), whose pivots are those of L D L'.

    A sweep of k takes S to S - 2 e e' - u u' / d, with e the unit vector k, d = S[k,k] and u = S e - e; all
    of them give -S^-1.
    """
    size = S.shape[0]
    for k in range(model.model.m):
        unit = np.zeros((size, size))
        unit[k, k] = 1.0
        E = model.c(f"E{k}", unit)
        pivot = named(S.picked(k), f"update: pivot {k}") if k else S
        d = named(pivot.alone(Opcode.RECIP, (1, 1)), f"update: 1 / pivot {k}")
        u = named(named(S @ E, f"update: column {k}") - E, f"update: column {k} less one")
        rest = named(S - model.c(f"E{k}_2", 2.0 * unit), f"update: S less two at {k}")
        S = named(rest.minus(named(u.scaled(d), f"update: u / d, {k}"), u), f"update: S swept to {k}")
    return named(model.c("zero", np.zeros((size, size))) - S, "update: S^-1")


def sequential(
    model: Matrices, x: Anything, P: Anything, z: Anything, V: Anything
) -> tuple[Anything, Anything]:
    """A scalar update for each measurement. Raises ProgramError where they are correlated."""
    linear = model.model
    if np.any(linear.R - np.diag(np.diag(linear.R))):
        raise ProgramError('[algorithm] "sequential" needs a diagonal R here: use "conventional"')
    z = measured(model, z)
    for j in range(linear.m):
        only = np.diag(np.eye(linear.m)[j])
        h = named(model.c(f"H{j}", only @ linear.H).rows_where(V), f"update {j}: h, if valid")
        hP = named(h @ P, f"update {j}: h P")
        Ph = named(hP.transposed(), f"update {j}: P h'")
        S = named(model.c(f"R{j}", only @ linear.R).plus(hP, h), f"update {j}: s")
        K = named(_over(Ph, S, j), f"update {j}: K")
        y = named(z.minus(h, x), f"update {j}: y")
        x = named(x.plus(K, y), f"update {j}: x")
        P = named(P.minus(K, Ph), f"update {j}: P")
    return x, P


def _over(Ph: Anything, S: Anything, j: int) -> Anything:
    """P h' / s, s being element j, j of S."""
    s = S if j == 0 else named(S.picked(j), f"update {j}: s alone")
    return Ph.scaled(named(s.alone(Opcode.RECIP, (1, 1)), f"update {j}: 1 / s"))
