"""The inverse of liu2007: an expansion about a covariance known beforehand."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from kalmanhdl.graph.linear_algebra import blocks
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.covariance import by_gain, innovation, observed
from kalmanhdl.processor.compiler.graph import named
from kalmanhdl.processor.compiler.recipe import Anything, Given, Kept, Matrices, Stage, near_one
from kalmanhdl.processor.compiler.turning import turning_up
from kalmanhdl.processor.instructions import Opcode


def expanded(model: Matrices, V: Anything, S0: Any, newton: int) -> Callable[[Anything, Anything], Anything]:
    """P H' X with X = 2 X0 - X0 S X0, liu2007 eq. 14 and 15, then X (2 I - S X) as often as asked for.

    X0 is the inverse of S0 over what is valid, as the diagonal V says.
    """

    def by_inverse(PHt: Anything, S: Anything) -> Anything:
        X0 = model.c("X0", _inverse(model, S0, S.shape[0]))
        correlated = [j for part in blocks(S0) if len(part) > 1 for j in part]
        if correlated:
            X0 = _of_valid(model, X0, V, correlated)
        return PHt @ _expanded(model, X0, S, newton)

    return by_inverse


def _inverse(model: Matrices, S0: Any, size: int) -> Any:
    """That of S0 in its units, one on the rest of the diagonal."""
    D, whole = near_one(model.model), np.eye(size)
    whole[: len(S0), : len(S0)] = np.linalg.inv(D @ S0 @ D)
    return whole


def _expanded(model: Matrices, X0: Anything, S: Anything, newton: int) -> Anything:
    """2 X0 - X0 S X0, and X (2 I - S X) as often as asked for."""
    size = S.shape[0]
    doubled = named(X0 + X0, "update: 2 X0")
    X = named(doubled.minus(named(X0 @ S, "update: X0 S"), X0), "update: S^-1")
    for step in range(newton):
        product = named(S @ X, f"update: S X, {step}")
        rest = named(model.c("I_2", 2.0 * np.eye(size)) - product, f"update: 2 I - S X, {step}")
        X = named(X @ rest, f"update: S^-1, {step + 1}")
    return X


def leaving_out(model: LinearModel, S0: Any, newton: int) -> tuple[Stage, ...] | None:
    """The stages of an update whose innovations are correlated; None where none are."""
    if all(len(part) == 1 for part in blocks(S0)):
        return None

    def begun(m: Matrices, kept: Kept, given: Given) -> Kept:
        size = given.V.builder.size
        missed = named(m.c("I", np.eye(size)) - given.V, "update: I - V")
        flags = named(missed @ m.c("ones_m", np.ones(model.m)), "update: flags of what is missed")
        return {**kept, "X0": m.c("X0_all", _inverse(m, S0, size)), "missed": flags}

    def gain(m: Matrices, kept: Kept, given: Given) -> Kept:
        found = observed(m, kept, given.V)
        X0 = _cleared(m, kept["X0"], given.V)
        K = named(found["PHt"] @ _expanded(m, X0, found["S"], newton), "update: K")
        y = innovation(m, kept["x"], given.z)
        return by_gain(m, {**found, "K": K, "y": y}, joseph=True)

    return (
        Stage(name="update", work=begun),
        Stage(name="missing", work=_next_left_out, times=model.m),
        Stage(name="gain", work=gain),
    )


def _next_left_out(m: Matrices, kept: Kept, given: Given) -> Kept:
    """As ``_of_valid``: the first one, and the next one comes to its place."""
    X, missed = kept["X0"], kept["missed"]
    size = X.shape[0]
    pivot = named(X.alone(Opcode.RECIP, (1, 1)), "update: 1 / X0[k,k]")
    column = named(X @ m.c("e0", np.eye(size)[0]), "update: column k of X0")
    if_missed = named(column.scaled(missed.as_matrix()), "update: the same, if k is missed")
    over = named(if_missed.scaled(pivot), "update: that over X0[k,k]")
    change = named(column.outer(over), "update: what k adds to X0")
    X = named(X - change, "update: X0 without k, if missed")
    turn = m.c("turn_m", turning_up(size, m.model.m))
    return {
        **kept,
        "X0": named(named(turn @ X, "update: its rows turned") @ turn.T, "update: X0 turned"),
        "missed": named(turn @ missed, "update: flags turned"),
    }


def _of_valid(model: Matrices, X: Anything, V: Anything, correlated: Sequence[int]) -> Anything:
    """The inverse of the part of S0 that is valid, from X, that of the whole; one where nothing is.

    To leave k out of what X is the inverse of takes X - X e e' X / X[k,k], with e the unit vector k.
    """
    size = X.shape[0]
    missed = named(model.c("I", np.eye(size)) - V, "update: I - V")
    for k in correlated:
        unit = model.c(f"e{k}", np.eye(size)[k])
        pivot = named(X.picked(k), f"update: X0[{k},{k}]").alone(Opcode.RECIP, (1, 1))
        named(pivot, f"update: 1 / X0[{k},{k}]")
        column = named(X @ unit, f"update: column {k} of X0")
        # The flag comes in while the reciprocal is found.
        if_missed = named(column.scaled(missed.picked(k)), f"update: the same, if {k} is missed")
        change = column.outer(named(if_missed.scaled(pivot), f"update: that over X0[{k},{k}]"))
        X = named(X - named(change, f"update: what {k} adds to X0"), f"update: X0 without {k}, if missed")
    return _cleared(model, X, V)


def _cleared(model: Matrices, X: Anything, V: Anything) -> Anything:
    """X of what is valid, one on the rest of the diagonal."""
    missed = named(model.c("I", np.eye(X.shape[0])) - V, "update: I - V")
    rows = named(X.rows_where(V), "update: V X0")
    valid = named(named(rows.transposed(), "update: X0 V").rows_where(V), "update: V X0 V")
    return named(valid + missed, "update: X0")
