"""The inverse of liu2007: an expansion about a covariance known beforehand."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from kalmanhdl.graph.linear_algebra import blocks
from kalmanhdl.processor.compiler.graph import named
from kalmanhdl.processor.compiler.recipe import Anything, Matrices, near_one
from kalmanhdl.processor.instructions import Opcode


def expanded(model: Matrices, V: Anything, S0: Any, newton: int) -> Callable[[Anything, Anything], Anything]:
    """P H' X with X = 2 X0 - X0 S X0, liu2007 eq. 14 and 15, then X (2 I - S X) as often as asked for.

    X0 is the inverse of S0 over what is valid, as the diagonal V says.
    """

    def by_inverse(PHt: Anything, S: Anything) -> Anything:
        D, size = near_one(model.model), S.shape[0]
        whole = np.eye(size)
        whole[: len(S0), : len(S0)] = np.linalg.inv(D @ S0 @ D)
        correlated = [j for part in blocks(S0) if len(part) > 1 for j in part]
        X0 = model.c("X0", whole)
        doubled = model.c("X0_2", 2.0 * whole)
        if correlated:
            X0 = _of_valid(model, X0, V, correlated)
            doubled = named(X0 + X0, "update: 2 X0")
        X = named(doubled.minus(named(X0 @ S, "update: X0 S"), X0), "update: S^-1")
        for step in range(newton):
            product = named(S @ X, f"update: S X, {step}")
            rest = named(model.c("I_2", 2.0 * np.eye(size)) - product, f"update: 2 I - S X, {step}")
            X = named(X @ rest, f"update: S^-1, {step + 1}")
        return PHt @ X

    return by_inverse


def _of_valid(model: Matrices, X: Anything, V: Anything, correlated: Sequence[int]) -> Anything:
    """The inverse of the part of S0 that is valid, from X, that of the whole; one where nothing is.

    To leave k out of what X is the inverse of takes X - X e e' X / X[k,k], with e the unit vector k.
    """
    size = X.shape[0]
    missed = named(model.c("I", np.eye(size)) - V, "update: I - V")
    for k in correlated:
        unit = model.c(f"e{k}", np.eye(size)[k])
        pivot = named(X.picked(k), f"update: X0[{k},{k}]").alone(Opcode.RECIP, (1, 1))
        if_missed = named(pivot.scaled(missed.picked(k)), f"update: 1 / X0[{k},{k}], if {k} is missed")
        column = named(X @ unit, f"update: column {k} of X0")
        change = column.outer(named(column.scaled(if_missed), f"update: the same over X0[{k},{k}]"))
        X = named(X - named(change, f"update: what {k} adds to X0"), f"update: X0 without {k}, if missed")
    rows = named(X.rows_where(V), "update: V X0")
    valid = named(named(rows.transposed(), "update: X0 V").rows_where(V), "update: V X0 V")
    return named(valid + missed, "update: X0")
