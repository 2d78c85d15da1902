"""The double-precision reference: the algorithm itself, run on floats."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Filter, Given, step
from kalmanhdl.algorithm.memory import Kept, Memory
from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.simulate.commands import Command

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimates:
    """What a filter put out, in the model's units; NaN where a row is no step.

    x (steps, tracks, n), P (steps, tracks, n, n), innovation (steps, tracks, m), nis (steps, tracks).
    """

    x: Array
    P: Array
    innovation: Array
    nis: Array


def reference(filter_: Filter, given: NDArray[np.int8], z: Array, u: Array) -> Estimates:
    """The estimates of a filter in double precision.

    Shapes: commands ``given`` (steps, tracks), z (steps, tracks, m) with NaN where missed,
    u (steps, tracks, p).
    """
    steps, tracks, m = z.shape
    memory = {kept.name: kept.whole({p: np.zeros(tracks) for p in kept.places()}) for kept in filter_.kept}
    n = len(filter_.estimate(memory).x)
    x, P = np.full((steps, tracks, n), np.nan), np.full((steps, tracks, n, n), np.nan)
    innovation, nis = np.full((steps, tracks, m), np.nan), np.full((steps, tracks), np.nan)
    for k in range(steps):
        acts = given[k] != Command.NONE
        # Tracks that have not started hold zeros, which some algorithms divide by.
        with np.errstate(all="ignore"):
            outcome = step(filter_, memory, _data(z[k], u[k], given[k]))
        memory = _kept(filter_.kept, acts, outcome.memory, memory)
        x[k, acts] = rows(outcome.belief.x, (tracks,))[acts]
        P[k, acts] = rows(outcome.belief.P, (tracks,))[acts]
        innovation[k, acts] = rows(outcome.innovation, (tracks,))[acts]
        nis[k, acts] = np.broadcast_to(np.asarray(outcome.nis, float), tracks)[acts]
    return Estimates(x=x, P=P, innovation=innovation, nis=nis)


def _kept(kept: tuple[Kept, ...], acts: NDArray[np.bool_], new: Memory, old: Memory) -> Memory:
    """The new memory of tracks that act, the old one of those that do not."""
    if acts.all():
        return new
    return {each.name: each.chosen(acts, new[each.name], old[each.name]) for each in kept}


def _data(z: Array, u: Array, given: NDArray[np.int8]) -> Given:
    seen = ~np.isnan(z) & (given != Command.PREDICT)[:, None]
    filled = np.nan_to_num(z)
    return Given(
        z=elements(filled),
        valid=tuple(seen.T),
        u=elements(u),
        initialise=given == Command.INITIALISE,
    )
