"""What the numbers of a nonlinear filter are like: double precision on tracks drawn from its model."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm import Extended
from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.simulate.commands import Command, commands
from kalmanhdl.simulate.reference import reference

Array = NDArray[np.float64]

_STEPS, _TRACKS, _COAST = 48, 48, 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """Vectors (k, ...) of k rows: states before a prediction and after it, and what comes with the row.

    ``deviations`` (n,) are those of the settled estimates, ``innovation`` (m,) variances of S.
    """

    before: Array
    predicted: Array
    z: Array
    u: Array
    first_z: Array
    first_u: Array
    deviations: Array
    innovation: Array


@cache
def samples(model: NonlinearModel) -> Samples:
    """The extended filter on tracks drawn from the model, in its units."""
    drawn = simulated(model, _COAST, _STEPS, _TRACKS)
    active = np.logical_and.accumulate(drawn.relevant, axis=0)
    z = np.where(drawn.valid & active[..., None], drawn.z, np.nan)
    given = commands(model, z, active)
    found = reference(Extended()(model), given, z, drawn.u)
    there = np.isfinite(found.x).all(axis=2) & (given != Command.NONE)
    steps = there[:-1] & there[1:] & (given[1:] != Command.INITIALISE)
    before, u = found.x[:-1][steps], drawn.u[1:][steps]
    P = found.P[:-1][steps]
    predicted = rows(model.transition(elements(before), elements(u)), before.shape[:1])
    first = given == Command.INITIALISE
    # In the order of their steps: the second half has settled.
    late = P[len(P) // 2 :]
    return Samples(
        before=before,
        predicted=predicted,
        z=drawn.z[1:][steps],
        u=u,
        first_z=drawn.z[first],
        first_u=drawn.u[first],
        deviations=np.sqrt(np.median(np.diagonal(late, axis1=1, axis2=2), axis=0)),
        innovation=_innovation(model, before, predicted, u, P),
    )


def _innovation(model: NonlinearModel, before: Array, predicted: Array, u: Array, P: Array) -> Array:
    """Variances of S between the middle and the largest ones, which the first rows of a track have."""
    count = before.shape[:1]
    F = rows(model.transition_slope(elements(before), elements(u)), count)
    H = rows(model.observation_slope(elements(predicted)), count)
    Q = rows(model.process_noise(elements(before), elements(u)), count)
    prior = F @ P @ F.swapaxes(1, 2) + Q
    S = H @ prior @ H.swapaxes(1, 2) + model.R
    variances = np.diagonal(S, axis1=1, axis2=2)
    return np.asarray(np.sqrt(np.median(variances, axis=0) * variances.max(axis=0)))
