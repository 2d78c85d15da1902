"""How good the estimates of a simulation are, against the truth and against the float reference.

Source of the consistency test: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, section 5.4.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.model import Model
from kalmanhdl.report.plots import plot_rates, plot_states, rate_sources
from kalmanhdl.simulate.commands import Command
from kalmanhdl.simulate.metrics import Consistency, chi_square_quantile, rmse
from kalmanhdl.simulate.side_by_side import SideBySide

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Differencing:
    """A rate from the last two plots, beside the filters at the same steps; errors against the truth.

    ``state`` is the rate's index, ``of`` that of the state it is the rate of; all errors are root mean
    squares in the rate's unit.
    """

    state: int
    of: int
    samples: int
    rmse: float
    rmse_reference: float
    rmse_bitexact: float


def differencing(model: Model, simulation: SideBySide) -> tuple[Differencing, ...]:
    """Two-point differencing of every rate of what plots show, where its truth is known."""
    truth = simulation.plots.truth
    if truth is None:
        return ()
    found = []
    shown = np.asarray(~np.isnan(plot_states(model, simulation.plots)).all(axis=(0, 1)))
    for i, p in rate_sources(model, shown).items():
        rate = plot_rates(model, simulation.plots, i, p)
        known = simulation.valid & ~np.isnan(rate) & ~np.isnan(truth[..., i])
        if known.any():
            errors = (rate, simulation.reference.x[..., i], simulation.exact.x[..., i])
            plain, reference, exact = (_root_mean_square((e - truth[..., i])[known]) for e in errors)
            found.append(
                Differencing(
                    state=i,
                    of=p,
                    samples=int(known.sum()),
                    rmse=plain,
                    rmse_reference=reference,
                    rmse_bitexact=exact,
                )
            )
    return tuple(found)


def measured_states(model: Model) -> dict[int, int]:
    """The measurements of a single state, each with that state."""
    return {j: seen.state for j, seen in model.seen.items()}


def updated(simulation: SideBySide, before_update: bool) -> NDArray[np.bool_]:
    """Where a measurement was used. Shape (steps, tracks, m).

    ``before_update``: the model's start makes an a priori belief, which the row of its command updates.
    """
    given = simulation.commands
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


def nis_inside(nis: Array, used: NDArray[np.bool_]) -> float:
    """The share of updates whose NIS is below what 95 % of them are if the model is right.

    Shapes as of ``mean_nis``.
    """
    degrees = used.sum(axis=-1)
    counted = (degrees > 0) & ~np.isnan(nis)
    limits = np.array([0.0, *(chi_square_quantile(0.95, k) for k in range(1, used.shape[-1] + 1))])
    return float(np.mean(nis[counted] <= limits[degrees[counted]])) if counted.any() else math.nan


def featured(simulation: SideBySide) -> int:
    """The track that stands for all: the one with most estimates, the first among equals."""
    return int(np.argmax(simulation.valid.sum(axis=0)))


def against_truth(simulation: SideBySide, estimate: Array) -> Array:
    """The root mean square error of each state, NaN where its truth is not known. Shape (n,)."""
    truth = simulation.plots.truth
    return np.full(estimate.shape[-1], np.nan) if truth is None else rmse(estimate, truth)


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
