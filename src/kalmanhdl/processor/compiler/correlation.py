"""Measurements whose errors are correlated, on whole matrices: what is missed has no part in the others.

Decorrelating them once for all would be wrong as soon as one is missed. So R of what is valid is factored in
every row: R = L D L', and the errors of L^-1 z have the variances D. The rows of H go the same way.
"""

from typing import Any

import numpy as np

from kalmanhdl.graph.linear_algebra import blocks
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.processor.compiler.graph import named
from kalmanhdl.processor.compiler.recipe import Anything, Given, Kept, Matrices, Stage
from kalmanhdl.processor.compiler.turning import in_units, turning_up
from kalmanhdl.processor.instructions import Opcode


def correlated(model: LinearModel) -> list[list[int]]:
    """The measurements that belong together, where there are several."""
    return [part for part in blocks(model.R) if len(part) > 1]


def noise_of_valid(m: Matrices, V: Anything, scale: Any) -> Anything:
    """R in the units that the diagonal ``scale`` makes, and one on the rest of the diagonal.

    Where R is no diagonal it is V R V + I - V, so that a missed measurement has no part in the others.
    """
    R, size = scale @ m.model.R @ scale, V.builder.size
    if not correlated(m.model):
        whole = np.eye(size)
        whole[: len(R), : len(R)] = R
        return m.c("R_D", whole)
    rows = named(m.c("R_D", R).rows_where(V), "update: V R")
    valid = named(named(rows.transposed(), "update: R V").rows_where(V), "update: V R V")
    missed = named(m.c("I", np.eye(size)) - V, "update: I - V")
    return named(valid + missed, "update: R of what is valid")


def decorrelated(m: Matrices, given: Given, scale: Any) -> tuple[Anything, Anything, Anything]:
    """H of what is valid, z, and a matrix with the variances of the errors on its diagonal.

    All of them in the units of ``scale``; the variance of what is missed is one.
    """
    H, z = in_units(m, given, scale)
    return taken_apart(m, H, z, given.V, scale)


def taken_apart(
    m: Matrices, H: Anything, z: Anything, V: Anything, scale: Any
) -> tuple[Anything, Anything, Anything]:
    """As ``decorrelated``, of H of what is valid and of z or its innovations in the units of ``scale``."""
    R = noise_of_valid(m, V, scale)
    for part in correlated(m.model):
        for place, j in enumerate(part[:-1]):
            below = np.zeros((m.model.m, m.model.m))
            below[part[place + 1 :], j] = 1.0
            H, z, R = _without(m, H, z, R, below, j, f"update {j}")
    return H, z, R


def decorrelating(model: LinearModel, scale: Any) -> tuple[Stage, ...]:
    """Stages before the measurements, a pass for each one; ``turning.measurements`` takes what they leave."""

    def begun(m: Matrices, kept: Kept, given: Given) -> Kept:
        H, z = in_units(m, given, scale)
        return {**kept, "H_row": H, "z_row": z, "R_left": noise_of_valid(m, given.V, scale)}

    return Stage(name="update", work=begun), Stage(name="errors", work=_next_apart, times=model.m)


def _next_apart(m: Matrices, kept: Kept, given: Given) -> Kept:
    """As ``decorrelated``: the first one out of the others, and the next one comes to its place."""
    count, R = m.model.m, kept["R_left"]
    size = R.builder.size
    below, apart = np.zeros((size, size)), np.ones((size, size))
    below[1:count, 0] = 1.0
    apart[1:, 0] = apart[0, 1:] = 0.0
    H, z, R = _without(m, kept["H_row"], kept["z_row"], R, below, 0, "update")
    # What stands behind the last one has had its turn.
    R = named(R.elementwise(m.c("apart", apart)), "update: the first error alone")
    turn = m.c("turn_m", turning_up(size, count))
    return {
        **kept,
        "H_row": named(turn @ H, "update: H of the next one"),
        "z_row": named(turn @ z, "update: z of the next one"),
        "R_left": named(named(turn @ R, "update: R, its rows turned") @ turn.T, "update: R turned"),
    }


def _without(
    m: Matrices, H: Anything, z: Anything, R: Anything, below: Any, j: int, where: str
) -> tuple[Anything, Anything, Anything]:
    """What measurement j tells of the errors ``below``, taken out of these: a step of L D L'."""
    pivot = R.picked(j) if j else R
    over = named(pivot.alone(Opcode.RECIP, (1, 1)), f"{where}: 1 / its variance")
    column = named(R.elementwise(m.c(f"below{j}", below)), f"{where}: its covariances")
    weights = named(column.scaled(over), f"{where}: its weights")
    R = named(R.minus(weights, column), f"{where}: R without its error")
    z = named(z.minus(weights, z), f"{where}: z without its error")
    return named(H - named(weights @ H, f"{where}: weights of h"), f"{where}: H without its error"), z, R
