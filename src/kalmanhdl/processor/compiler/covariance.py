"""Filters that keep the covariance, on whole matrices."""

from collections.abc import Callable

import numpy as np

from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.correlation import (
    correlated,
    decorrelated,
    decorrelating,
    noise_of_valid,
)
from kalmanhdl.processor.compiler.graph import named
from kalmanhdl.processor.compiler.recipe import (
    Anything,
    Given,
    Kept,
    Matrices,
    Recipe,
    Stage,
    measured,
    near_one,
    predicted_mean,
)
from kalmanhdl.processor.compiler.turning import first_of, measurements, moved_on, turning_up
from kalmanhdl.processor.instructions import Opcode

ADJUGATE = 3
"""The size of the matrices whose inverse is found by adjugate and determinant."""

Update = Callable[[Matrices, Anything, Anything, Anything, Anything], tuple[Anything, Anything]]
"""From the a priori x and P, the measurement z and the diagonal V of its valid flags to the new x and P."""


def keeping_covariance(update: Update, stages: tuple[Stage, ...] | None = None) -> Recipe:
    """The filter with an update, of which ``stages`` do the same in fewer words."""

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
        stages=None if stages is None else ((Stage(name="step", work=_predicted),), stages),
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
    found = observed(model, {"x": x, "P": P}, V)
    found["K"] = named(by_inverse(found["PHt"], found["S"]), "update: K")
    kept = by_gain(model, {**found, "y": innovation(model, x, z)}, joseph=joseph)
    return kept["x"], kept["P"]


def observed(model: Matrices, prior: Kept, V: Anything) -> dict[str, Anything]:
    """x and P with what a gain is made of: H of what is valid, P H' and S."""
    D, x, P = near_one(model.model), prior["x"], prior["P"]
    H = named(model.c("H_D", D @ model.model.H).rows_where(V), "update: H of what is valid")
    HP = named(H @ P, "update: H P")
    PHt = named(HP.transposed(), "update: P H'")
    S = named(noise_of_valid(model, V, D).plus(HP, H), "update: S")
    return {"x": x, "P": P, "HV": H, "PHt": PHt, "S": S}


def innovation(model: Matrices, x: Anything, z: Anything) -> Anything:
    """What x does not explain of z, in the units of S."""
    y = named(measured(model, z).minus(model.H, x), "update: y")
    return named(model.c("D", near_one(model.model)) @ y, "update: y in its units")


def by_gain(model: Matrices, found: Kept, *, joseph: bool) -> Kept:
    """The new x and P, by the gain K, the innovation y and what ``observed`` found."""
    x, P, K, H = (found[name] for name in ("x", "P", "K", "HV"))
    x = named(x.plus(K, found["y"]), "update: x")
    if not joseph:
        return {"x": x, "P": named(P.minus(K, found["PHt"]), "update: P")}
    D = near_one(model.model)
    A = named(model.c("I", np.eye(model.model.n)) - named(K @ H, "update: K H"), "update: I - K H")
    KR = named(K @ model.c("R_D", D @ model.model.R @ D), "update: K R")
    noise = named(KR @ K.T, "update: K R K'")
    return {"x": x, "P": named(noise.plus(named(A @ P, "update: A P"), A), "update: P")}


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


def sweeping(model: LinearModel, size: int, *, joseph: bool) -> tuple[Stage, ...] | None:
    """The stages of an update with sweeps, a pass each; None where there are none."""
    if model.m == 1 or (model.m <= ADJUGATE and size == ADJUGATE):
        return None

    def gain(m: Matrices, kept: Kept, given: Given) -> Kept:
        inverse = named(m.c("zero", np.zeros((size, size))) - kept["S"], "update: S^-1")
        return by_gain(m, {**kept, "K": named(kept["PHt"] @ inverse, "update: K")}, joseph=joseph)

    def begun(m: Matrices, kept: Kept, given: Given) -> Kept:
        return {**observed(m, kept, given.V), "y": innovation(m, kept["x"], given.z)}

    return (
        Stage(name="update", work=begun),
        Stage(name="sweeps", work=_next_sweep, times=model.m),
        Stage(name="gain", work=gain),
    )


def _next_sweep(m: Matrices, kept: Kept, given: Given) -> Kept:
    """As ``_swept``: of the first diagonal element, and the next one comes to its place."""
    S = kept["S"]
    size = S.shape[0]
    unit = np.diag(np.eye(size)[0])
    d = named(S.alone(Opcode.RECIP, (1, 1)), "update: 1 / pivot")
    u = named(named(S @ m.c("E0", unit), "update: its column") - m.c("E0", unit), "update: column less one")
    rest = named(S - m.c("E0_2", 2.0 * unit), "update: S less two there")
    S = named(rest.minus(named(u.scaled(d), "update: u / d"), u), "update: S swept")
    turn = m.c("turn_m", turning_up(size, m.model.m))
    return {**kept, "S": named(named(turn @ S, "update: its rows turned") @ turn.T, "update: S turned")}


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
    """A scalar update for each measurement; their errors are taken apart first, where R is no diagonal."""
    linear = model.model
    if correlated(linear):
        H, z, R = decorrelated(model, Given(z=z, V=V, u=None), near_one(linear))
    else:
        z = measured(model, z)
    for j in range(linear.m):
        only = np.diag(np.eye(linear.m)[j])
        if correlated(linear):
            h, r = named(model.c(f"E{j}", only) @ H, f"update {j}: h"), R
        else:
            h = named(model.c(f"H{j}", only @ linear.H).rows_where(V), f"update {j}: h, if valid")
            r = model.c(f"R{j}", only @ linear.R)
        K, Ph = scalar_gain(P, h, r, j)
        y = named(z.minus(h, x), f"update {j}: y")
        x = named(x.plus(K, y), f"update {j}: x")
        P = named(P.minus(K, Ph), f"update {j}: P")
    return x, P


def sequential_stages(model: LinearModel) -> tuple[Stage, ...]:
    """The stages of a sequential update, a pass for each measurement."""
    scale = near_one(model) if correlated(model) else np.eye(model.m)
    first = decorrelating(model, scale) if correlated(model) else ()

    def begun(m: Matrices, kept: Kept, given: Given) -> Kept:
        return {"x": kept["x"], "P": kept["P"], **measurements(m, kept, given, scale)}

    return (
        *first,
        Stage(name="scalars" if first else "update", work=begun),
        Stage(name="measurements", work=_next_scalar, times=model.m),
    )


def _next_scalar(m: Matrices, kept: Kept, given: Given) -> Kept:
    """As ``sequential``: by the measurement that stands first, and the others move up."""
    x, P = kept["x"], kept["P"]
    h, y = first_of(m, kept)
    size = y.builder.size
    first = m.c("e0", np.eye(size)[0])
    Ph = named(P @ h, "update: P h'")
    shares = named(h.times(Ph), "update: h P h', apart")
    s = named(kept["r_row"].plus(m.c("sum", np.eye(size)[:1].T @ np.ones((1, size))), shares), "update: s")
    K = named(Ph.scaled(named(s.as_matrix().alone(Opcode.RECIP, (1, 1)), "update: 1 / s")), "update: K")
    x = named(x + named(K.scaled(y.as_matrix()), "update: K y"), "update: x")
    columns = (named(K.outer(first), "update: K as a column"), named(Ph.outer(first), "update: P h' as one"))
    return {"x": x, "P": named(P.minus(*columns), "update: P"), **moved_on(m, kept)}


def scalar_gain(P: Anything, h: Anything, r: Anything, j: int) -> tuple[Anything, Anything]:
    """The gain of measurement j, in column j, and P h'.

    ``h`` has a row j alone; element j, j of ``r`` is its variance.
    """
    hP = named(h @ P, f"update {j}: h P")
    Ph = named(hP.transposed(), f"update {j}: P h'")
    S = named(r.plus(hP, h), f"update {j}: s")
    return named(_over(Ph, S, j), f"update {j}: K"), Ph


def _over(Ph: Anything, S: Anything, j: int) -> Anything:
    """P h' / s, s being element j, j of S."""
    s = S if j == 0 else named(S.picked(j), f"update {j}: s alone")
    return Ph.scaled(named(s.alone(Opcode.RECIP, (1, 1)), f"update {j}: 1 / s"))
