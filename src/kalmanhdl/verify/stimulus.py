"""Steps for the hardware: which track, which command, which raw numbers, in which order."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.operations import Flag, Input
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.ranges import STEPS, simulated
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.simulate.commands import Command, commands
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.simulate.side_by_side import stimulus_of

# Of random steps one in twenty starts its track anew and one in eight only predicts; a component is
# missed one time in six, and one step in twelve is left out so that the order of tracks varies.
_COAST = 5
_INITIALISE, _PREDICT, _MISSED, _IDLE = 0.05, 0.125, 1 / 6, 1 / 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Steps:
    """Rows of steps of tracks. Every array is (rows, tracks); inactive places are no step.

    ``order`` lists the places row * tracks + track in the order in which the steps are sent.
    """

    commands: NDArray[np.int8]
    inputs: dict[str, Integers]
    flags: dict[str, NDArray[np.bool_]]
    order: NDArray[np.int64]

    @property
    def active(self) -> NDArray[np.bool_]:
        """Where there is a step."""
        return np.asarray(self.commands != Command.NONE)


def from_plots(model: Model, typed: TypedGraph, plots: Plots, channels: int) -> Steps:
    """The steps of data, row by row; more tracks than channels take turns, one group after the other."""
    stimulus = stimulus_of(model, typed, plots)
    given = _grouped(stimulus.commands, channels, Command.NONE)
    return Steps(
        commands=given,
        inputs={name: _grouped(raws, channels, 0) for name, raws in stimulus.inputs.items()},
        flags={name: _grouped(flags, channels, False) for name, flags in stimulus.flags.items()},
        order=np.flatnonzero((given != Command.NONE).ravel()),
    )


def _grouped(array: NDArray[Any], channels: int, filling: int) -> NDArray[Any]:
    """(rows, tracks) as (groups * rows, channels): groups of tracks in succession, the last filled up."""
    rows, tracks = array.shape
    groups = -(-tracks // channels)
    wide = np.full((rows, groups * channels), filling, array.dtype)
    wide[:, :tracks] = array
    return wide.reshape(rows, groups, channels).swapaxes(0, 1).reshape(groups * rows, channels)


def from_model(model: Model, typed: TypedGraph, count: int, channels: int, seed: int) -> Steps:
    """``count`` steps of tracks that the model itself draws, started anew every few dozen rows."""
    rows = -(-count // channels)
    blocks = -(-rows // STEPS)
    drawn = simulated(model, _COAST, tracks=channels * blocks, seed=seed)

    def arranged(array: NDArray[np.float64]) -> NDArray[np.float64]:
        split = array.reshape(STEPS, blocks, channels, -1).swapaxes(0, 1)
        return split.reshape(blocks * STEPS, channels, -1)[:rows]

    z = np.where(drawn.valid, drawn.z, np.nan)
    given = commands(model, z, np.ones(z.shape[:2], bool))
    plots = Plots(
        tracks=tuple(map(str, range(channels))),
        z=arranged(z),
        u=arranged(drawn.u),
        active=np.ones((rows, channels), bool),
        time=None,
        truth=None,
    )
    steps = from_plots(model, typed, plots, channels)
    acts = arranged(given[..., None].astype(float))[..., 0].astype(np.int8)
    flags = {**steps.flags, "initialise": acts == Command.INITIALISE}
    order = np.arange(rows * channels)[:count]
    return Steps(commands=_first(acts, count), inputs=steps.inputs, flags=flags, order=order)


def _first(given: NDArray[np.int8], count: int) -> NDArray[np.int8]:
    flat = given.copy().ravel()
    flat[count:] = Command.NONE
    return flat.reshape(given.shape)


def random_steps(typed: TypedGraph, count: int, channels: int, seed: int) -> Steps:
    """``count`` steps of raw numbers from anywhere in their formats, tracks in random order."""
    random = np.random.default_rng(seed)
    rows = -(-count // channels) * 2 if channels > 1 else count
    shape = (rows, channels)
    active = random.random(shape) >= _IDLE if channels > 1 else np.ones(shape, bool)
    order = _shuffled(random, active)[:count]
    chosen = np.zeros(rows * channels, bool)
    chosen[order] = True
    active = chosen.reshape(shape)
    drawn = random.random(shape)
    given = np.where(drawn < _INITIALISE + _PREDICT, Command.PREDICT, Command.UPDATE)
    given = np.where(drawn < _INITIALISE, Command.INITIALISE, given)
    given = np.where(active, given, Command.NONE).astype(np.int8)
    inputs, flags = {}, {"initialise": given == Command.INITIALISE}
    for operation, form in zip(typed.graph.operations, typed.formats, strict=True):
        if isinstance(operation, Input):
            assert form is not None
            inputs[operation.name] = _anywhere(random, form, shape)
        elif isinstance(operation, Flag) and operation.name != "initialise":
            seen = random.random(shape) >= _MISSED
            flags[operation.name] = seen & (given != Command.PREDICT)
    return Steps(commands=given, inputs=inputs, flags=flags, order=order)


def _shuffled(random: np.random.Generator, active: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The active places row by row, the tracks of a row in random order."""
    keys = np.where(active, random.random(active.shape), 2.0)
    tracks = np.argsort(keys, axis=1)
    places = tracks + np.arange(len(active))[:, None] * active.shape[1]
    taken = np.arange(active.shape[1]) < active.sum(axis=1)[:, None]
    return np.asarray(places[taken])


def _anywhere(random: np.random.Generator, form: Fixed, shape: tuple[int, int]) -> Integers:
    """Raw integers: half of them anywhere, a quarter small, a quarter at the limits."""
    if form.width > 62:
        bits = random.integers(0, 2, (*shape, form.width)).astype(object)
        return np.asarray((bits * [1 << k for k in range(form.width)]).sum(axis=-1) + form.lowest)
    anywhere = random.integers(form.lowest, form.highest, shape, endpoint=True)
    small = anywhere >> (form.width // 2)
    limits = np.where(random.random(shape) < 0.5, form.lowest, form.highest)
    kind = random.random(shape)
    return np.where(kind < 0.5, anywhere, np.where(kind < 0.75, small, limits))
