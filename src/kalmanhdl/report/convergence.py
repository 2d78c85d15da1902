"""What a filter believed before each update: the variance of its innovations, and its gains.

Derived from the covariances that a simulation put out; nothing of it is recorded by the hardware.
"""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.simulate.commands import Command
from kalmanhdl.simulate.side_by_side import SideBySide

Array = NDArray[np.float64]


def priors(model: LinearModel, simulation: SideBySide, P: Array) -> Array:
    """F P F' + Q of the step before, and P0 where the row's own command starts the track.

    Shape (steps, tracks, n, n), NaN where the step before has no estimate.
    """
    prior = np.full_like(P, np.nan)
    prior[1:] = model.F @ P[:-1] @ model.F.T + model.Q
    if model.initial.before_update:
        prior[simulation.commands == Command.INITIALISE] = model.initial.P
    return prior


def innovation_covariances(model: LinearModel, prior: Array) -> Array:
    """S = H P H' + R. Shapes (..., n, n) and (..., m, m)."""
    return np.asarray(model.H @ prior @ model.H.T + model.R)


def gains(model: LinearModel, prior: Array, used: NDArray[np.bool_]) -> Array:
    """The optimal gain P H' S^-1 where every component was measured, NaN elsewhere. Shape (..., n, m)."""
    whole = used.all(axis=-1) & np.isfinite(prior).all(axis=(-1, -2))
    result = np.full((*prior.shape[:-2], model.n, model.m), np.nan)
    P = prior[whole]
    S = innovation_covariances(model, P)
    result[whole] = np.swapaxes(np.linalg.solve(S, model.H @ P), -1, -2)
    return result
