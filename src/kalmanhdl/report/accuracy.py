"""How good the estimates of a simulation are, against the truth and against the float reference.

Source of the consistency test: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, section 5.4.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.model.varying import VaryingModel
from kalmanhdl.simulate.commands import Command
from kalmanhdl.simulate.metrics import Consistency, chi_square_quantile, rmse
from kalmanhdl.simulate.side_by_side import Simulation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Differencing:
    """A rate from the last two plots, beside the filters at the same steps; errors against the truth.

    ``state`` and ``measurement`` are indices; all errors are root mean squares in the state's unit.
    """

    state: int
    measurement: int
    samples: int
    rmse: float
    rmse_reference: float
    rmse_bitexact: float


def rate_sources(model: Model) -> dict[int, tuple[int, int]]:
    """The states that are the rate of a measured one, each with that measurement and the measured state.

    State i is the rate of state p where F carries i into p directly, not by way of a third state, which
    would make it an acceleration.
    """
    found: dict[int, tuple[int, int]] = {}
    model = _linear(model)
    if not isinstance(model, LinearModel):
        return found
    for j, p in measured_states(model).items():
        carried = [i for i in np.flatnonzero(model.F[p]) if i != p]
        for i in carried:
            through = any(k not in (i, p) and model.F[k, i] != 0 for k in carried)
            if not through and model.F[p, p] == model.F[i, i] == 1:
                found.setdefault(int(i), (j, p))
    return dict(sorted(found.items()))


def _linear(model: Model) -> Model:
    """A model that varies is in its form what it is in the middle of its inputs' limits."""
    return model.fixed if isinstance(model, VaryingModel) else model


def measured_states(model: Model) -> dict[int, int]:
    """The measurements of a single state, each with that state."""
    return {j: seen.state for j, seen in model.seen.items()}


def differencing(model: Model, simulation: Simulation) -> tuple[Differencing, ...]:
    """Two-point differencing of every measured rate whose truth is known.

    A difference of two successive plots is divided by the time between them, or by the T that stands in
    F where the data has no times.
    """
    truth = simulation.plots.truth
    model = _linear(model)
    if truth is None or not isinstance(model, LinearModel):
        return ()
    found = []
    for i, (j, p) in rate_sources(model).items():
        rate = plot_rates(model, simulation, i, j, p)
        known = simulation.valid & ~np.isnan(rate) & ~np.isnan(truth[..., i])
        if known.any():
            errors = (rate, simulation.reference.x[..., i], simulation.exact.x[..., i])
            plain, reference, exact = (_root_mean_square((e - truth[..., i])[known]) for e in errors)
            found.append(
                Differencing(
                    state=i,
                    measurement=j,
                    samples=int(known.sum()),
                    rmse=plain,
                    rmse_reference=reference,
                    rmse_bitexact=exact,
                )
            )
    return tuple(found)


def states_shown(model: Model, z: Array, j: int) -> Array:
    """The states that plots of a measurement of one state show. Shapes (..., m) and (...)."""
    seen = model.seen[j]
    return np.asarray((z[..., j] - seen.offset) / seen.factor)


def plot_rates(model: LinearModel, simulation: Simulation, i: int, j: int, p: int) -> Array:
    """The rate i of state p from each plot j and the one before it, NaN where one is missed."""
    plots = simulation.plots
    position = states_shown(model, plots.z, j)
    rate = np.full(position.shape, np.nan)
    passed = np.diff(plots.time, axis=0) if plots.time is not None else model.F[p, i]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate[1:] = np.diff(position, axis=0) / passed
    return np.where(np.isfinite(rate), rate, np.nan)


def updated(simulation: Simulation, before_update: bool) -> NDArray[np.bool_]:
    """Where a measurement was used. Shape (steps, tracks, m).

    ``before_update``: the model's start makes an a priori belief, which the row of its command updates.
    """
    given = simulation.stimulus.commands
    updates = (given == Command.UPDATE) | ((given == Command.INITIALISE) & before_update)
    used: NDArray[np.bool_] = ~np.isnan(simulation.plots.z) & (updates & simulation.valid)[..., None]
    return used


def mean_nis(nis: Array, used: NDArray[np.bool_]) -> Consistency:
    """The mean of the normalised innovation squared over the steps that used a measurement, with its band.

    A step counts with as many degrees of freedom as components were used. Shapes: (steps, tracks) and
    (steps, tracks, m).
    """
    degrees = used.sum(axis=-1)
    counted = (degrees > 0) & ~np.isnan(nis)
    samples, total = int(counted.sum()), int(degrees[counted].sum())
    if not samples:
        return Consistency(mean=math.nan, low=math.nan, high=math.nan, samples=0)
    return Consistency(
        mean=float(nis[counted].mean()),
        low=chi_square_quantile(0.025, total) / samples,
        high=chi_square_quantile(0.975, total) / samples,
        samples=samples,
    )


def featured(simulation: Simulation) -> int:
    """The track that stands for all: the one with most estimates, the first among equals."""
    return int(np.argmax(simulation.valid.sum(axis=0)))


def against_truth(simulation: Simulation, estimate: Array) -> Array:
    """The root mean square error of each state, NaN where its truth is not known. Shape (n,)."""
    truth = simulation.plots.truth
    return np.full(estimate.shape[-1], np.nan) if truth is None else rmse(estimate, truth)


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
