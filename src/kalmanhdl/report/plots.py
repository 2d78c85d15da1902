"""What plots say by themselves: the states that one row shows, and rates from two rows in succession."""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.model.conversion import conversion
from kalmanhdl.model.converted import ConvertedModel
from kalmanhdl.model.model import Model
from kalmanhdl.model.multiple import MultipleModel
from kalmanhdl.model.nonlinear import MeasuredInitial, NonlinearModel
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.model.varying import VaryingModel
from kalmanhdl.simulate.data import Plots

Array = NDArray[np.float64]


def states_shown(model: Model, z: Array, j: int) -> Array:
    """The states that plots of a measurement of one state show. Shapes (..., m) and (...)."""
    seen = model.seen[j]
    return np.asarray((z[..., j] - seen.offset) / seen.factor)


def plot_states(model: Model, plots: Plots) -> Array:
    """The states that each row shows by itself, NaN for the others and where it shows none.

    Measurements of one state show it; range and angles show the position that they are converted to; of a
    nonlinear model a row shows what a track that starts from it takes of it. Shape (steps, tracks, n).
    """
    z = plots.z
    shown = np.full((*z.shape[:-1], model.n), np.nan)
    for j, seen in model.seen.items():
        shown[..., seen.state] = states_shown(model, z, j)
    if isinstance(model, ConvertedModel):
        position = rows(model.converted(conversion(model.variances), elements(z)), z.shape[:-1])
        for row, along in zip(np.moveaxis(position, -1, 0), model.positions.H, strict=True):
            if np.count_nonzero(along) == 1:
                shown[..., np.flatnonzero(along)[0]] = row / along[along != 0]
    if isinstance(model, NonlinearModel) and isinstance(model.initial, MeasuredInitial):
        mean, _ = model.start(elements(np.zeros(shown.shape)), elements(z), elements(plots.u))
        taken = model.initial.mean.dependence("z", model.m).any(axis=1)
        shown[..., taken] = rows(mean, z.shape[:-1])[..., taken]
    return shown


def constant_transition(model: Model) -> Array:
    """The matrix F of the motion, NaN where it is no constant. Shape (n, n)."""
    match model:
        case LinearModel():
            return model.F
        case MultipleModel():
            return np.where(
                np.all([mode.F == model.first.F for mode in model.modes], axis=0), model.first.F, np.nan
            )
        case ConvertedModel():
            return model.positions.F
        case VaryingModel():
            # In its form what it is in the middle of its inputs' limits.
            return constant_transition(model.fixed)
        case NonlinearModel():
            vectors = (("x", model.n), ("u", model.p))
            varying = np.any([model.F.dependence(letter, k).any(axis=1) for letter, k in vectors], axis=0)
            anywhere = elements(np.ones((1, model.n))), elements(np.zeros((1, model.p)))
            with np.errstate(all="ignore"):
                F = rows(model.transition_slope(*anywhere), (1,))[0]
            return np.where(varying.reshape(F.shape), np.nan, F)
        case _:
            return np.full((model.n, model.n), np.nan)


def rate_sources(model: Model, shown: NDArray[np.bool_]) -> dict[int, int]:
    """The states that are the rate of one that plots show, each with that state.

    State i is the rate of state p where F carries i into p directly, not by way of a third state, which
    would make it an acceleration.
    """
    F = constant_transition(model)
    found: dict[int, int] = {}
    for p in np.flatnonzero(shown):
        carried = [int(i) for i in np.flatnonzero(F[p]) if i != p]
        for i in carried:
            through = any(k not in (i, p) and F[k, i] != 0 for k in carried)
            if not through and F[p, p] == F[i, i] == 1 and np.isfinite(F[p, i]):
                found.setdefault(i, int(p))
    return dict(sorted(found.items()))


def plot_rates(model: Model, plots: Plots, i: int, p: int) -> Array:
    """The rate i of state p from each row and the one before it, NaN where one does not show it.

    A difference is divided by the time between the rows, or by what stands in F where there are no times.
    """
    position = plot_states(model, plots)[..., p]
    rate = np.full(position.shape, np.nan)
    passed = np.diff(plots.time, axis=0) if plots.time is not None else constant_transition(model)[p, i]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate[1:] = np.diff(position, axis=0) / passed
    return np.where(np.isfinite(rate), rate, np.nan)
