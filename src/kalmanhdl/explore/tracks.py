"""The tracks that formats are chosen and judged on: drawn from the model, and the user's own."""

from dataclasses import dataclass, replace
from typing import Any

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
from kalmanhdl.simulate.reference import Estimates, reference

Array = NDArray[np.float64]

_STEPS = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judged:
    """Plots, and what the float reference makes of them.

    ``valid`` (steps, tracks) tells where there is an estimate, ``reference`` (steps, tracks, n) which,
    ``octave`` (steps, tracks) how old the track is: 1, 2 to 3, 4 to 7 steps and so on. ``spread`` (n,) is
    the reference's root mean square error, ``octave_spread`` (octaves, n) that in each octave: against the
    truth, or by its own covariance where the plots have no truth.
    """

    plots: Plots
    commands: NDArray[np.int8]
    valid: NDArray[np.bool_]
    estimates: Estimates
    reference: Array
    octave: NDArray[np.int64]
    spread: Array
    octave_spread: Array

    def excess(self, x: Array) -> Array:
        """By how much of the reference's error the error of x (steps, tracks, n) is greater. Shape (n,).

        The greater of two measures. Directly: the error against the truth, where there is one. And by the
        distance d to the reference: what is added to a least-squares estimate is uncorrelated with its
        error e, so that the error becomes sqrt(e^2 + d^2), which chance does not touch. The latter holds in
        each octave of a track's age, lest the large errors of a start hide those of the settled filter.
        """
        seen = np.where(self.valid[..., None], x, np.nan)
        apart = _by_octave(np.square(seen - self.reference), self.octave, len(self.octave_spread))
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = apart / self.octave_spread
        # An error that is zero is met where nothing is added to it.
        relative = np.where(apart == 0.0, 0.0, relative)
        grown = np.hypot(1.0, np.nan_to_num(relative, nan=0.0, posinf=np.inf)).max(axis=0) - 1.0
        grown = np.where(np.isnan(apart).all(axis=0), np.nan, grown)
        if self.plots.truth is None:
            return np.asarray(grown)
        direct = rmse(seen, self.plots.truth) / self.spread - 1.0
        return np.fmax(grown, direct)

    def worst(self, x: Array, count: int) -> Plots:
        """The tracks on which x (steps, tracks, n) comes furthest from the reference."""
        far = np.where(self.valid[..., None], np.abs(x - self.reference) / self.spread, 0.0)
        order = np.argsort(-np.nan_to_num(far, nan=np.inf).max(axis=(0, 2)), kind="stable")
        return _only(self.plots, np.sort(order[:count]))


def usual_steps(model: Model) -> int:
    """How long tracks are: 200 steps; as long as those that ranges rest on where none are declared."""
    return ranges.STEPS if model.measurement_range is None else _STEPS


def drawn_plots(model: Model, coast: int, steps: int, tracks: int, seed: int) -> Plots:
    """Tracks drawn from the model; they end where they leave its ranges.

    Every second one is slow enough to stay in them, where the model leaves that open: ``ranges.unhurried``.
    Plots are missed among them, at most ``coast`` in a row, or none with a coast of 0.
    """
    random = np.random.default_rng(seed)
    slow = np.arange(tracks)[:, None] % 2 == 1
    found = ranges.drawn(model, random, steps, tracks, np.where(slow, ranges.unhurried(model, steps), 1.0))
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
    octave = np.frexp(np.cumsum(valid, axis=0))[1].astype(np.int64) - 1
    octaves = int(octave.max(initial=0)) + 1
    spread = np.sqrt(np.nanmean(variances, axis=(0, 1)))
    octave_spread = _by_octave(variances, octave, octaves)
    if plots.truth is not None:
        squares = np.square(x - plots.truth)
        against, by_octave = rmse(x, plots.truth), _by_octave(squares, octave, octaves)
        spread = np.where(np.isnan(against), spread, against)
        octave_spread = np.where(np.isnan(by_octave), octave_spread, by_octave)
    return Judged(
        plots=plots,
        commands=given,
        valid=valid,
        estimates=estimates,
        reference=x,
        octave=octave,
        spread=spread,
        octave_spread=octave_spread,
    )


def _by_octave(squares: Array, octave: NDArray[np.int64], octaves: int) -> Array:
    """Roots of the means of squares (steps, tracks, n) by octave: (octaves, n), NaN where there is none."""
    result = np.full((octaves, squares.shape[-1]), np.nan)
    for i in range(squares.shape[-1]):
        there = ~np.isnan(squares[..., i])
        place = octave[there]
        count = np.bincount(place, minlength=octaves)[:octaves]
        total = np.bincount(place, squares[..., i][there], minlength=octaves)[:octaves]
        result[count > 0, i] = np.sqrt(total[count > 0] / count[count > 0])
    return result


def drive_of(program: Program, scaling: Scaling, on: Judged) -> Drive:
    """What a program is fed for plots; see ``simulate.side_by_side.stimulus_of``."""
    z, given = on.plots.z, on.commands
    inputs = {f"z[{j}]": z[..., j] / unit for j, unit in enumerate(scaling.measurement)}
    inputs |= {f"u[{k}]": on.plots.u[..., k] / unit for k, unit in enumerate(scaling.control)}
    flags = {f"valid[{j}]": ~np.isnan(z[..., j]) & (given != Command.PREDICT) for j in range(z.shape[2])}
    flags["initialise"] = given == Command.INITIALISE
    shape = given.shape
    return Drive(
        inputs=_rows([np.nan_to_num(inputs[name]) for name in program.inputs], np.float64, shape),
        flags=_rows([flags[name] for name in program.flags], np.uint8, shape),
        commands=np.ascontiguousarray((given != Command.NONE).astype(np.uint8) + on.valid, np.uint8),
    )


def _rows(arrays: list[Any], kind: type, shape: tuple[int, ...]) -> NDArray[Any]:
    """(k, steps, tracks), in C's order whatever that of the arrays is."""
    return np.ascontiguousarray(np.array(arrays, kind, order="C").reshape(-1, *shape))


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
