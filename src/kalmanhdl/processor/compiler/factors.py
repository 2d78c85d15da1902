"""The filter of Bierman and Thornton, on whole matrices: P = U D U', of which L = U' and D are kept.

Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapters V and VI.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalmanhdl.algorithm.bierman_thornton import factors, vanishing_variances
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.correlation import correlated, decorrelated, decorrelating
from kalmanhdl.processor.compiler.graph import Array, named
from kalmanhdl.processor.compiler.recipe import (
    Anything,
    Given,
    Kept,
    Matrices,
    Recipe,
    Stage,
    near_one,
    predicted_mean,
)
from kalmanhdl.processor.compiler.turning import first_of, in_units, measurements, moved_on
from kalmanhdl.processor.instructions import Opcode


def factored(model: LinearModel) -> Recipe:
    """The filter of a model whose variances of D never vanish. Raises ProgramError for others."""
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
        stages=_stages(model),
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


def _stages(model: LinearModel) -> tuple[tuple[Stage, ...], tuple[Stage, ...]]:
    """A pass for each row of F U, and one for each measurement."""
    rows = Stage(name="rows", work=_next_row, times=model.n)
    each = Stage(name="measurements", work=_next_measurement, times=model.m)
    first = decorrelating(model, near_one(model)) if correlated(model) else ()
    begun = Stage(name="scalars" if first else "update", work=_measurements_begun)
    return (Stage(name="step", work=_rows_begun), rows), (*first, begun, each)


def _predicted(m: Matrices, kept: Kept, given: Given) -> Kept:
    """Thornton: the rows of [F U, G] made orthogonal under the weights of D and Q, the last one first."""
    n = m.model.n
    G, q = _noise(m.model)
    W, d = named(m.F @ kept["L"].T, "predict: F U"), kept["d"]
    noise = m.c("G", G) if len(q) else None
    L, D = m.c("I", np.eye(n)), None
    for j in range(n - 1, -1, -1):
        unit = _unit(m, j, d)
        row, row_of_noise, s = _products(m, W, noise, d, unit, f"predict {j}")
        alone = named(s.times(unit), f"predict {j}: D")
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
        L = named(L + named(unit.outer(u), f"predict {j}: row of L"), f"predict: L from {j} on")
    return {"x": predicted_mean(m, kept["x"], given), "L": L, "d": D}


def _noise(model: LinearModel) -> tuple[Any, Any]:
    """G (n, k) and q (k,), all of it more than zero, with Q = G diag(q) G'."""
    G, q = factors(model.Q)
    return G[:, q > 0], q[q > 0]


def _products(
    m: Matrices, W: Anything, noise: Anything, d: Anything, unit: Anything, where: str
) -> tuple[Anything, Anything, Anything]:
    """Of the row that ``unit`` names: itself in F U and in G, and its weighted products with all rows."""
    row = named(named(W.transposed(), f"{where}: U' F'") @ unit, f"{where}: row")
    s = named(W @ named(row.times(d), f"{where}: row, weighted"), f"{where}: products")
    if noise is None:
        return row, None, s
    row_of_noise = named(noise.transposed() @ unit, f"{where}: row of G")
    weighted = named(row_of_noise.times(m.c("q", _noise(m.model)[1])), f"{where}: row of G, weighted")
    return row, row_of_noise, named(s.plus(noise, weighted), f"{where}: products with G")


def _rows_begun(m: Matrices, kept: Kept, given: Given) -> Kept:
    """What the passes over rows begin with: F U and G, the last row's unit vector, the rows above it."""
    n = m.model.n
    G, q = _noise(m.model)
    found = {
        "x": predicted_mean(m, kept["x"], given),
        "weights": kept["d"],
        "d": m.c("none", np.zeros(n)),
        "W": named(m.F @ kept["L"].T, "predict: F U"),
        "L": m.c("I", np.eye(n)),
        "e": _unit(m, n - 1, kept["d"]),
        "above": m.c("rows_above", 1.0 * (np.arange(n) < n - 1)),
    }
    return found | ({"noise": m.c("G", G)} if len(q) else {})


def _next_row(m: Matrices, kept: Kept, given: Given) -> Kept:
    """As ``_predicted``: one row, and on to the one above."""
    where, weights = "predict", kept["weights"]
    size = weights.builder.size
    unit, above, noise = kept["e"], kept["above"], kept.get("noise")
    row, row_of_noise, s = _products(m, kept["W"], noise, weights, unit, where)
    alone = named(s.times(unit), f"{where}: D of the row")
    D = named(m.c("sum", np.eye(size)[:1].T @ np.ones((1, size))) @ alone, f"{where}: D alone")
    over = named(D.as_matrix().alone(Opcode.RECIP, (1, 1)), f"{where}: 1 / D")
    u = named(named(s.times(above), f"{where}: products with rows above").scaled(over), f"{where}: U")
    up = m.c("up", np.eye(size, k=1))
    W = named(kept["W"] - named(u.outer(row), f"{where}: along F U"), f"{where}: F U less that")
    found = {
        **kept,
        "W": W,
        "L": named(kept["L"] + named(unit.outer(u), f"{where}: row of L"), f"{where}: L so far"),
        "d": named(kept["d"] + alone, f"{where}: D so far"),
        "e": named(up @ unit, f"{where}: the row above"),
        "above": named(up @ above, f"{where}: rows above that"),
    }
    if noise is not None:
        along = named(u.outer(row_of_noise), f"{where}: along G")
        found["noise"] = named(noise - along, f"{where}: G less that")
    return found


def _measurements_begun(m: Matrices, kept: Kept, given: Given) -> Kept:
    """What the passes over measurements begin with."""
    return {
        **{name: kept[name] for name in ("x", "L", "d")},
        **measurements(m, kept, given, near_one(m.model)),
    }


def _next_measurement(m: Matrices, kept: Kept, given: Given) -> Kept:
    """As ``_updated``: by the measurement that stands first, and the others move up."""
    h, y = first_of(m, kept)
    ones = m.c("ones", np.ones(m.model.n))
    noise = named(ones.scaled(kept["r_row"].as_matrix()), "update: r everywhere")
    found = _by_one(m, {name: kept[name] for name in ("x", "L", "d")}, h, y, 0, noise, "update")
    return {**found, **moved_on(m, kept)}


def _updated(m: Matrices, kept: Kept, given: Given) -> Kept:
    """Bierman: one measurement after the other, in units in which the settled innovations are near one."""
    model, scale = m.model, near_one(m.model)
    if correlated(model):
        H, z, R = decorrelated(m, given, scale)
        ones = m.c("ones", np.ones(model.n))
        noises = [named(ones.scaled(R.picked(j)), f"update {j}: r everywhere") for j in range(model.m)]
    else:
        H, z = in_units(m, given, scale)
        r = np.diag(scale @ model.R @ scale)
        noises = [m.c(f"r{j}", np.full(model.n, r[j])) for j in range(model.m)]
    rows = named(H.transposed(), "update: H' of what is valid")
    found: Kept = kept
    for j, noise in enumerate(noises):
        h = named(rows @ _unit(m, j, rows), f"update {j}: h")
        y = named(z.minus(H, found["x"]), f"update {j}: y")
        found = _by_one(m, found, h, y, j, noise, f"update {j}")
    return found


def _by_one(m: Matrices, kept: Kept, h: Anything, y: Anything, j: int, noise: Anything, where: str) -> Kept:
    """By z = h' x + v alone. Element j of y is its innovation, every one of ``noise`` the variance of v."""
    n, L, d = m.model.n, kept["L"], kept["d"]

    def note(value: Anything, what: str) -> Any:
        return named(value, f"{where}: {what}")

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
