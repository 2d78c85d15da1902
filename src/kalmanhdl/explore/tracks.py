"""The tracks that formats are chosen and judged on: drawn from the model, and the user's own."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Filter
from kalmanhdl.explore.format_engine import Drive
from kalmanhdl.explore.program import Program
from kalmanhdl.model.model import Model
from kalmanhdl.numerics import ranges
from kalmanhdl.numerics.scaling import Scaling
from kalmanhdl.simulate.commands import Command, commands, started
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.metrics import rmse
from kalmanhdl.simulate.reference import reference

Array = NDArray[np.float64]

_STEPS = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judged:
    """Plots, and what the float reference makes of them.

    ``valid`` (steps, tracks) tells where there is an estimate, ``reference`` (steps, tracks, n) which,
    ``spread`` (n,) is its root mean square error: against the truth, or by its own covariance where the
    plots have no truth.
    """

    plots: Plots
    commands: NDArray[np.int8]
    valid: NDArray[np.bool_]
    reference: Array
    spread: Array

    def excess(self, x: Array) -> Array:
        """By how much of the reference's error the error of x (steps, tracks, n) is greater. Shape (n,).

        The greater of two measures. Directly: the error against the truth, where there is one. And by the
        distance d to the reference: what is added to a least-squares estimate is uncorrelated with its
        error e, so that the error becomes sqrt(e^2 + d^2), which chance does not touch.
        """
        seen = np.where(self.valid[..., None], x, np.nan)
        apart = np.hypot(1.0, rmse(seen, self.reference) / self.spread) - 1.0
        if self.plots.truth is None:
            return apart
        direct = rmse(seen, self.plots.truth) / self.spread - 1.0
        return np.fmax(apart, direct)

    def worst(self, x: Array, count: int) -> Plots:
        """The tracks on which x (steps, tracks, n) comes furthest from the reference."""
        far = np.where(self.valid[..., None], np.abs(x - self.reference) / self.spread, 0.0)
        order = np.argsort(-np.nan_to_num(far, nan=np.inf).max(axis=(0, 2)), kind="stable")
        return _only(self.plots, np.sort(order[:count]))


def usual_steps(model: Model) -> int:
    """How long tracks are: 200 steps; as long as those that ranges rest on where none are declared."""
    return ranges.STEPS if model.measurement_range is None else _STEPS


def drawn_plots(model: Model, coast: int, steps: int, tracks: int, seed: int) -> Plots:
    """Tracks drawn from the model, with missed plots among them; they end where they leave its ranges."""
    random = np.random.default_rng(seed)
    found = ranges.drawn(model, random, steps, tracks)
    there = ranges.missed_now_and_then(model, random, steps, tracks, coast)
    return Plots(
        tracks=tuple(map(str, range(tracks))),
        z=np.where(there, found.z, np.nan),
        u=found.u,
        active=found.relevant,
        time=None,
        truth=found.truth,
    )


def judged(model: Model, filter_: Filter, plots: Plots) -> Judged:
    """The float reference's estimates on plots."""
    given = commands(model, plots.z, plots.active)
    valid = started(model, given)
    estimates = reference(filter_, given, plots.z, plots.u)
    x = np.where(valid[..., None], estimates.x, np.nan)
    variances = np.where(valid[..., None], np.diagonal(estimates.P, axis1=2, axis2=3), np.nan)
    spread = np.sqrt(np.nanmean(variances, axis=(0, 1)))
    if plots.truth is not None:
        against = rmse(x, plots.truth)
        spread = np.where(np.isnan(against), spread, against)
    return Judged(plots=plots, commands=given, valid=valid, reference=x, spread=spread)


def drive_of(program: Program, scaling: Scaling, on: Judged) -> Drive:
    """What a program is fed for plots; see ``simulate.side_by_side.stimulus_of``."""
    z, given = on.plots.z, on.commands
    inputs = {f"z[{j}]": z[..., j] / unit for j, unit in enumerate(scaling.measurement)}
    inputs |= {f"u[{k}]": on.plots.u[..., k] / unit for k, unit in enumerate(scaling.control)}
    flags = {f"valid[{j}]": ~np.isnan(z[..., j]) & (given != Command.PREDICT) for j in range(z.shape[2])}
    flags["initialise"] = given == Command.INITIALISE
    shape = given.shape
    return Drive(
        inputs=np.array([np.nan_to_num(inputs[name]) for name in program.inputs]).reshape(-1, *shape),
        flags=np.array([flags[name] for name in program.flags], np.uint8).reshape(-1, *shape),
        commands=((given != Command.NONE).astype(np.uint8) + on.valid).astype(np.uint8),
    )


def from_the_start(model: Model, plots: Plots) -> ranges.Plots:
    """Plots as the range analysis takes them: every track begins with the rows that start it."""
    given = commands(model, plots.z, plots.active)
    steps, tracks = given.shape
    z, u = np.zeros_like(plots.z), np.zeros_like(plots.u)
    valid, relevant = np.zeros(z.shape, bool), np.zeros((steps, tracks), bool)
    for track in range(tracks):
        rows = np.flatnonzero(given[:, track] != Command.NONE)
        there = slice(0, len(rows))
        z[there, track], u[there, track] = np.nan_to_num(plots.z[rows, track]), plots.u[rows, track]
        valid[there, track] = ~np.isnan(plots.z[rows, track])
        relevant[there, track] = True
    return ranges.Plots(z=z, u=u, valid=valid, relevant=relevant)


def split(plots: Plots) -> tuple[Plots, Plots]:
    """Data to choose formats by, and data to judge them by: every second track, or the first half of one."""
    tracks = len(plots.tracks)
    if tracks == 1:
        first = np.arange(len(plots.z))[:, None] < len(plots.z) // 2
        return replace(plots, active=plots.active & first), plots
    return _only(plots, np.arange(0, tracks, 2)), _only(plots, np.arange(1, tracks, 2))


def joined(a: Plots, b: Plots) -> Plots:
    """Drawn tracks of as many steps side by side."""
    assert a.truth is not None
    assert b.truth is not None
    return Plots(
        tracks=(*a.tracks, *b.tracks),
        z=np.concatenate([a.z, b.z], axis=1),
        u=np.concatenate([a.u, b.u], axis=1),
        active=np.concatenate([a.active, b.active], axis=1),
        time=None,
        truth=np.concatenate([a.truth, b.truth], axis=1),
    )


def _only(plots: Plots, chosen: NDArray[np.int64]) -> Plots:
    return Plots(
        tracks=tuple(plots.tracks[k] for k in chosen),
        z=plots.z[:, chosen],
        u=plots.u[:, chosen],
        active=plots.active[:, chosen],
        time=None if plots.time is None else plots.time[:, chosen],
        truth=None if plots.truth is None else plots.truth[:, chosen],
    )
