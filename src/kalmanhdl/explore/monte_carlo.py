"""Is a filter consistent? Float reference and bit-exact engine over many tracks drawn from its model.

Source of the tests: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation,
section 5.4.
"""

import math
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.design import Design
from kalmanhdl.numerics import ranges
from kalmanhdl.numerics.integers import Numbers, numbers
from kalmanhdl.simulate.commands import Command
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.metrics import Consistency, autocorrelation, consistency, mean_band, nees, rmse
from kalmanhdl.simulate.reference import Estimates
from kalmanhdl.simulate.side_by_side import Simulation, simulate

Array = NDArray[np.float64]
Progress = Callable[[str], None]

# Tracks that are drawn together, from a seed of their own: the result does not know how many processes ran.
_TOGETHER = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tested:
    """One filter's statistics.

    ``nees`` is of the last step that every track reached, over tracks; ``nees_inside`` the share of steps
    whose mean over tracks lies in its band of 95 %. ``nis`` is over all updates, which are independent.
    ``autocorrelation`` (m,) is of successive innovations, ``limit`` what 95 % of white ones stay below.
    """

    nees: Consistency
    nees_inside: float
    nis: Consistency
    autocorrelation: Array
    limit: Array
    rmse: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MonteCarlo:
    """Float reference and bit-exact engine on the same tracks; ``saturations`` are of the engine."""

    tracks: int
    steps: int
    reference: Tested
    exact: Tested
    saturations: int


@dataclass(frozen=True, slots=True)
class _Job:
    design: Design
    numbers: Numbers
    steps: int


@dataclass(frozen=True, slots=True)
class _Sample:
    """NEES, NIS (steps, tracks), innovations and errors of one filter on some tracks."""

    nees: Array
    nis: Array
    innovation: Array
    error: Array


_job: _Job | None = None


def monte_carlo(
    design: Design,
    *,
    tracks: int = 1000,
    steps: int = 200,
    seed: int = 1,
    processes: int = 2,
    progress: Progress = lambda _: None,
) -> MonteCarlo:
    """Statistics over tracks drawn from the model, none of whose measurements is missed.

    A track ends where it leaves the declared ranges. Equal seeds give equal results, whatever the number
    of processes. Raises DesignError where the design is not in fixed point.
    """
    progress("tracing the filter and compiling the engine")
    job = _Job(design, numbers(design.model, design.algorithm, design.fixed_point), steps)
    Engine.of(job.numbers.typed)
    seeds = np.random.SeedSequence(seed).spawn(-(-tracks // _TOGETHER))
    sizes = [min(_TOGETHER, tracks - k * _TOGETHER) for k in range(len(seeds))]
    found: list[tuple[_Sample, _Sample, int]] = []
    # Forked, since a model may hold functions that cannot be sent.
    context = get_context("fork")
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_begin, initargs=(job,))
    try:
        for sample in pool.map(_sampled, seeds, sizes):
            found.append(sample)
            progress(f"{min(len(found) * _TOGETHER, tracks)} of {tracks} tracks")
    finally:
        pool.shutdown(cancel_futures=True)
    n, m = design.model.n, design.model.m
    return MonteCarlo(
        tracks=tracks,
        steps=steps,
        reference=_tested([reference for reference, _, _ in found], n, m),
        exact=_tested([exact for _, exact, _ in found], n, m),
        saturations=sum(count for _, _, count in found),
    )


def _begin(job: _Job) -> None:
    global _job
    _job = job
    # The parent alone answers Ctrl-C, and ends its children.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _sampled(seed: np.random.SeedSequence, tracks: int) -> tuple[_Sample, _Sample, int]:
    assert _job is not None
    model, random = _job.design.model, np.random.default_rng(seed)
    drawn = ranges.drawn(model, random, _job.steps, tracks)
    plots = Plots(
        tracks=tuple(map(str, range(tracks))),
        z=drawn.z,
        u=drawn.u,
        active=drawn.relevant,
        time=None,
        truth=drawn.truth,
    )
    simulation = simulate(model, _job.design.algorithm(model), _job.numbers, plots)
    return *_samples(simulation), simulation.saturations


def tested(simulation: Simulation) -> tuple[Tested, Tested]:
    """The statistics of float reference and engine over tracks with a truth, of which no plot is missed."""
    n, m = simulation.exact.x.shape[-1], simulation.exact.innovation.shape[-1]
    reference, exact = _samples(simulation)
    return _tested([reference], n, m), _tested([exact], n, m)


def _samples(simulation: Simulation) -> tuple[_Sample, _Sample]:
    truth = simulation.plots.truth
    assert truth is not None
    updates = simulation.valid & (simulation.commands == Command.UPDATE)
    return (
        _sample(simulation.reference, truth, simulation.valid, updates),
        _sample(simulation.exact, truth, simulation.valid, updates),
    )


def _sample(
    estimates: Estimates, truth: Array, valid: NDArray[np.bool_], updates: NDArray[np.bool_]
) -> _Sample:
    error = estimates.x - truth
    squares = np.full(valid.shape, np.nan)
    squares[valid] = _squares(error[valid], estimates.P[valid])
    return _Sample(
        nees=squares,
        nis=np.where(updates, estimates.nis, np.nan),
        innovation=np.where(updates[..., None], estimates.innovation, np.nan),
        error=error,
    )


def _squares(error: Array, P: Array) -> Array:
    """NEES, infinite where rounding has left a covariance singular."""
    regular = np.linalg.matrix_rank(P / _scale(P)) == P.shape[-1]
    result = np.full(len(error), math.inf)
    result[regular] = nees(error[regular], P[regular])
    return result


def _scale(P: Array) -> Array:
    spread = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), np.finfo(float).tiny))
    return spread[:, :, None] * spread[:, None, :]


def _tested(samples: list[_Sample], n: int, m: int) -> Tested:
    squares = np.concatenate([sample.nees for sample in samples], axis=1)
    nis = np.concatenate([sample.nis for sample in samples], axis=1)
    innovation = np.concatenate([sample.innovation for sample in samples], axis=1)
    error = np.concatenate([sample.error for sample in samples], axis=1)
    counts = (~np.isnan(squares)).sum(axis=1)
    last = int(np.flatnonzero(counts == counts.max())[-1])
    pairs = (~np.isnan(innovation[:-1]) & ~np.isnan(innovation[1:])).sum(axis=(0, 1))
    return Tested(
        nees=consistency(squares[last], n),
        nees_inside=_inside(squares, n),
        nis=consistency(nis, m),
        autocorrelation=autocorrelation(innovation),
        limit=1.96 / np.sqrt(np.maximum(pairs, 1)),
        rmse=rmse(error, np.zeros_like(error)),
    )


def _inside(squares: Array, n: int) -> float:
    """The share of steps whose mean lies in the band for as many tracks as were there."""
    inside = []
    for row in squares:
        there = row[~np.isnan(row)]
        if there.size:
            low, high = mean_band(n, there.size)
            inside.append(low <= there.mean() <= high)
    return float(np.mean(inside)) if inside else math.nan
