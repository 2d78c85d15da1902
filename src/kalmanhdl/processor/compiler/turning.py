"""Measurements one after the other: matrices turn, and what stands first in them is of the next one."""

from typing import Any

import numpy as np

from kalmanhdl.processor.compiler.graph import named
from kalmanhdl.processor.compiler.recipe import Anything, Given, Kept, Matrices, measured


def turning_up(size: int, count: int) -> Any:
    """What takes each of the first ``count`` rows one place up, the first one to their end."""
    turn = np.eye(size)
    turn[:count, :count] = np.roll(np.eye(count), 1, axis=1)
    return turn


def measurements(m: Matrices, kept: Kept, given: Given, scale: Any) -> Kept:
    """H of what is valid, z and the diagonal of R, in the units that the diagonal ``scale`` makes.

    Where R was no diagonal, what ``correlation.decorrelating`` left of all three.
    """
    model = m.model
    if "R_left" in kept:
        ones = m.c("ones_m", np.ones(model.m))
        return {
            **{name: kept[name] for name in ("H_row", "z_row")},
            "r_row": named(kept["R_left"] @ ones, "update: variances of the errors"),
        }
    H, z = in_units(m, given, scale)
    return {"H_row": H, "z_row": z, "r_row": m.c("r", np.diag(scale @ model.R @ scale))}


def in_units(m: Matrices, given: Given, scale: Any) -> tuple[Anything, Anything]:
    """H of what is valid and z, in the units that the diagonal ``scale`` makes."""
    H = named(m.c("H_D", scale @ m.model.H).rows_where(given.V), "update: H of what is valid")
    return H, named(m.c("D", scale) @ measured(m, given.z), "update: z in its units")


def first_of(m: Matrices, kept: Kept) -> tuple[Anything, Anything]:
    """h of the measurement that stands first, and what of every measurement x does not explain."""
    H = kept["H_row"]
    first = m.c("e0", np.eye(H.builder.size)[0])
    h = named(named(H.transposed(), "update: H'") @ first, "update: h")
    return h, named(kept["z_row"].minus(H, kept["x"]), "update: y")


def moved_on(m: Matrices, kept: Kept) -> Kept:
    """The next measurement stands first."""
    size = kept["H_row"].builder.size
    turn = m.c("turn_up", turning_up(size, size))
    return {
        name: named(turn @ kept[name], f"update: {what} of the next one")
        for name, what in (("H_row", "H"), ("z_row", "z"), ("r_row", "r"))
    }
