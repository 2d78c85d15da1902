"""The filter of Bierman and Thornton, on whole matrices: P = U D U', of which L = U' and D are kept.

Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapters V and VI.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalmanhdl.algorithm.bierman_thornton import factors, vanishing_variances
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.graph import Array, named
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


def factored(model: LinearModel) -> Recipe:
    """The filter of a model whose R is diagonal and whose variances of D never vanish.

    Raises ProgramError for others.
    """
    if np.any(model.R - np.diag(np.diag(model.R))):
        raise ProgramError('[algorithm] "bierman_thornton" needs a diagonal R here: use "joseph"')
    gone = vanishing_variances(model)
    if gone:
        names = ", ".join(model.state_names[k] for k in sorted(gone))
        raise ProgramError(
            f'[algorithm] "bierman_thornton" divides by variances, and that of {names} comes to zero: '
            'use "joseph", or give the start and Q some variance'
        )
    U, D = factors(model.initial.P)
    return Recipe(
        vectors=("x", "d", "v"),
        matrices=("L",),
        begin=lambda m: {"L": m.c("L0", U.T), "d": m.c("d0", D)},
        predict=_predicted,
        update=_updated,
        finish=_with_variances,
        variances="v",
        covariance=_covariance,
    )


def _covariance(values: Mapping[str, Array]) -> Array:
    L, d = values["L"], values["d"]
    P = np.asarray(L.T * d @ L)
    np.fill_diagonal(P, values["v"])
    return P


def _with_variances(m: Matrices, kept: Kept) -> Kept:
    """The diagonal of U D U': the squares of U times D."""
    U = named(kept["L"].transposed(), "output: U")
    squares = named(U.elementwise(U), "output: squares of U")
    return {**kept, "v": named(squares @ kept["d"], "output: variances")}


def _unit(m: Matrices, k: int, of: Anything) -> Anything:
    """The unit vector k, as long as the core's matrices: one constant wherever it is needed."""
    return m.c(f"e{k}", np.eye(of.builder.size)[k])


def _predicted(m: Matrices, kept: Kept, given: Given) -> Kept:
    """Thornton: the rows of [F U, G] made orthogonal under the weights of D and Q, the last one first."""
    n = m.model.n
    G, q = factors(m.model.Q)
    G, q = G[:, q > 0], q[q > 0]
    W, d = named(m.F @ kept["L"].T, "predict: F U"), kept["d"]
    noise = m.c("G", G) if len(q) else None
    L, D = m.c("I", np.eye(n)), None
    for j in range(n - 1, -1, -1):
        row = named(named(W.transposed(), f"predict {j}: U' F'") @ _unit(m, j, d), f"predict {j}: row")
        s = named(W @ named(row.times(d), f"predict {j}: row, weighted"), f"predict {j}: products")
        if noise is not None:
            row_of_noise = named(noise.transposed() @ _unit(m, j, d), f"predict {j}: row of G")
            weighted = named(row_of_noise.times(m.c("q", q)), f"predict {j}: row of G, weighted")
            s = named(s.plus(noise, weighted), f"predict {j}: products with G")
        alone = named(s.times(_unit(m, j, d)), f"predict {j}: D")
        D = alone if D is None else named(D + alone, f"predict: D from {j} on")
        if j == 0:
            break
        over = named(
            named(s.picked(j), f"predict {j}: D alone").alone(Opcode.RECIP, (1, 1)), f"predict {j}: 1 / D"
        )
        above = named(s.times(m.c(f"above{j}", np.arange(n) < j)), f"predict {j}: products with rows above")
        u = named(above.scaled(over), f"predict {j}: U")
        W = named(W - named(u.outer(row), f"predict {j}: along F U"), f"predict {j}: F U less that")
        if noise is not None:
            along = named(u.outer(row_of_noise), f"predict {j}: along G")
            noise = named(noise - along, f"predict {j}: G less that")
        L = named(L + named(_unit(m, j, d).outer(u), f"predict {j}: row of L"), f"predict: L from {j} on")
    return {"x": predicted_mean(m, kept["x"], given), "L": L, "d": D}


def _updated(m: Matrices, kept: Kept, given: Given) -> Kept:
    """Bierman: one measurement after the other, in units in which the settled innovations are near one."""
    model = m.model
    scale = near_one(model)
    H = named(m.c("H_D", scale @ model.H).rows_where(given.V), "update: H of what is valid")
    rows = named(H.transposed(), "update: H' of what is valid")
    z = named(m.c("D", scale) @ measured(m, given.z), "update: z in its units")
    found: Kept = kept
    for j in range(model.m):
        h = named(rows @ _unit(m, j, rows), f"update {j}: h")
        y = named(z.minus(H, found["x"]), f"update {j}: y")
        found = _measured(m, found, h, y, j, float((scale @ model.R @ scale)[j, j]))
    return found


def _measured(m: Matrices, kept: Kept, h: Anything, y: Anything, j: int, r: float) -> Kept:
    """By z = h' x + v alone, v of variance r. Element j of y is its innovation."""
    n, L, d = m.model.n, kept["L"], kept["d"]

    def note(value: Anything, what: str) -> Any:
        return named(value, f"update {j}: {what}")

    noise = m.c(f"r{j}", np.full(n, r))
    f = note(L @ h, "f = U' h")
    g = note(f.times(d), "g = D f")
    shares = note(f.times(g), "f g")
    after = note(noise.plus(m.c("sums", np.tri(n)), shares), "variances up to each state")
    over = note(after.reciprocals(), "1 / these")
    last = note(over.picked(n - 1), "1 / s")
    b = note(note(L.transposed(), "U") @ g, "U g")
    step = note(last.scaled(note(y.picked(j), "y alone")), "y / s")
    x = note(kept["x"] + note(b.scaled(step), "K y"), "x")
    if n == 1:
        before, lower = noise, L
    else:
        before = note(noise.plus(m.c("sums_before", np.tri(n, k=-1)), shares), "variances before each state")
        shifted = note(m.c("shift", np.eye(n, k=-1)) @ over, "1 / those before")
        weights = note(f.times(shifted), "f / those before")
        change = note(weights.outer(g), "weights g'")
        change = note(
            change.elementwise(m.c("minus_below", -np.tri(n, k=-1))), "minus these below the diagonal"
        )
        lower = note(note(m.c("I", np.eye(n)) + change, "change of L") @ L, "L")
    ratio = note(before.times(over), "before over after")
    return {"x": x, "L": lower, "d": note(d.times(ratio), "D")}
