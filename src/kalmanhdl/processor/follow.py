"""A filter's program on data: what it reads, and its estimates beside those of double precision."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm import Algorithm
from kalmanhdl.model.model import Array, Model
from kalmanhdl.model.units import Units
from kalmanhdl.numerics.ranges import Plots as Drawn
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import rows_read
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.simulate.commands import Command, commands, started
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.reference import Estimates, reference
from kalmanhdl.simulate.side_by_side import SideBySide, where

Rows = tuple[tuple[int, ...], ...]
"""The raw numbers that a program reads, row after row."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Followed(SideBySide):
    """Float reference and program side by side; the program puts out neither innovations nor their squares.

    ``saturations`` counts the rows with an estimate in which a result did not fit the core's numbers,
    ``clipped`` the measurements and controls that did not.
    """

    saturations: int
    clipped: int


def rows_of(core: Core, model: Model, scaling: Units, plots: Plots) -> tuple[Rows, ...]:
    """What the program reads of each track, from its start on. The model is that of the plots."""
    given = commands(model, plots.z, plots.active)
    z, u = plots.z / scaling.measurement, plots.u / scaling.control
    acts = given != Command.NONE
    return tuple(
        rows_read(core, z[acts[:, track], track], u[acts[:, track], track])
        for track in range(len(plots.tracks))
    )


def follow(
    filter_: Traced,
    core: Core,
    model: Model,
    algorithm: Algorithm,
    scaling: Units,
    plots: Plots,
) -> Followed:
    """The program's estimates of every track, each from a program just loaded, beside the float reference.

    ``filter_`` is that of the model in the units of ``scaling``; model, algorithm and plots are in their own.
    """
    given = commands(model, plots.z, plots.active)
    valid = started(model, given)
    n = model.n
    x, P = np.full((*valid.shape, n), np.nan), np.full((*valid.shape, n, n), np.nan)
    saturations = clipped = 0
    for track, rows in enumerate(rows_of(core, model, scaling, plots)):
        at = np.flatnonzero(given[:, track] != Command.NONE)
        found = _run(filter_, core, rows, valid[at, track])
        x[at, track], P[at, track] = found.x * scaling.state, found.P * scaling.covariances()
        saturations += found.saturations
        clipped += _at_the_ends(core, rows, model.m)
    unknown = np.full((*valid.shape, model.m), np.nan)
    exact = Estimates(x=x, P=P, innovation=unknown, nis=np.full(valid.shape, np.nan))
    return Followed(
        plots=plots,
        commands=given,
        valid=valid,
        reference=where(valid, reference(algorithm(model), given, plots.z, plots.u)),
        exact=where(valid, exact),
        saturations=saturations,
        clipped=clipped,
    )


def matrix_units(scaling: Units, size: int) -> dict[str, Array]:
    """What one is in elements (size, size) of what is kept, read and put out, in the model's units."""
    n = len(scaling.state)
    covariances = scaling.covariances()
    whole = {"P": covariances, "L": np.divide.outer(scaling.state, scaling.state).T}
    rows = {"x": scaling.state, "z": scaling.measurement, "u": scaling.control}
    rows |= dict.fromkeys(("v", "d"), np.diag(covariances))
    found = {name: np.ones((size, size)) for name in (*whole, *rows)}
    for name, units in whole.items():
        found[name][:n, :n] = units
    for name, units in rows.items():
        found[name][0, : len(units)] = units
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Track:
    """Estimates (steps, n) and (steps, n, n) in the units of the hardware; rows that saturated."""

    x: Array
    P: Array
    saturations: int


def _run(filter_: Traced, core: Core, rows: Rows, counts: NDArray[np.bool_]) -> _Track:
    engine, shape = Engine(filter_, core), (core.size, core.size)
    estimates, saturations = [], 0
    for row, counted in zip(rows, counts, strict=True):
        engine.saturated = False
        engine.step(row)
        saturations += bool(engine.saturated and counted)
        numbers = {name: np.reshape(core.numbers.reals(raws), shape) for name, raws in engine.stored.items()}
        estimates.append(filter_.estimate(numbers))
    n = filter_.model.n
    return _Track(
        x=np.reshape([x for x, _ in estimates], (-1, n)),
        P=np.reshape([P for _, P in estimates], (-1, n, n)),
        saturations=saturations,
    )


def _at_the_ends(core: Core, rows: Rows, m: int) -> int:
    """Measurements and controls that stand at an end of the format: they were clipped, or nearly so."""
    return sum(core.numbers.is_end(number) for row in rows for number in row[m:])


def as_data(drawn: Drawn) -> Plots:
    """Tracks drawn from a model as data, each as long as it counts."""
    active = np.logical_and.accumulate(drawn.relevant, axis=0)
    return Plots(
        tracks=tuple(map(str, range(drawn.z.shape[1]))),
        z=np.where(drawn.valid & active[..., None], drawn.z, np.nan),
        u=np.where(active[..., None], drawn.u, 0.0),
        active=active,
        time=None,
        truth=None,
    )
