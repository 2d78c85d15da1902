"""Steps for the hardware: which track, which command, which raw numbers, in which order."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import Flag, Input
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.ranges import STEPS, simulated
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.interface import Interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.commands import Command, commands
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.simulate.side_by_side import coefficient_inputs, stimulus_of
from kalmanhdl.toolchain.simulation import Stalls
from kalmanhdl.verify.clocks import Clocks, clocks_of
from kalmanhdl.verify.walk import Walk

# Of random steps one in twenty starts its track anew and one in eight only predicts, some of these by the
# fourth code; a component is missed one time in six.
_COAST = 5
_INITIALISE, _PREDICT, _FOURTH, _MISSED = 0.05, 0.125, 0.02, 1 / 6
# The fourth code of a command, which predicts.
FOURTH = 3
# How often either side of the streams pauses: as a rule, and in some short sections.
_STALLS = (0.25, 0.5, 0.75)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Steps:
    """Rows of steps of tracks. Every array is (rows, tracks); inactive places are no step.

    ``order`` lists the places row * tracks + track in the order in which the steps are sent: all of them, or
    those of one of several streams. ``flags`` are
    what counts; a measurement may be ``offered`` with a prediction all the same.
    """

    commands: NDArray[np.int8]
    inputs: dict[str, Integers]
    flags: dict[str, NDArray[np.bool_]]
    order: NDArray[np.int64]
    offered: dict[str, NDArray[np.bool_]]

    @property
    def tracks(self) -> NDArray[np.int64]:
        """The track of each step, in sending order."""
        return np.asarray(self.order % self.commands.shape[1])

    @property
    def active(self) -> NDArray[np.bool_]:
        """Where there is a step."""
        return np.asarray(self.commands != Command.NONE)


def from_plots(model: Model, typed: TypedGraph | FloatGraph, plots: Plots, channels: int) -> Steps:
    """The steps of data, row by row; more tracks than channels take turns, one group after the other."""
    stimulus = stimulus_of(model, typed, plots)
    given = _grouped(stimulus.commands, channels, Command.NONE)
    flags = {name: _grouped(flags, channels, False) for name, flags in stimulus.flags.items()}
    return Steps(
        commands=given,
        inputs={name: _grouped(raws, channels, 0) for name, raws in stimulus.inputs.items()},
        flags=flags,
        order=np.flatnonzero((given != Command.NONE).ravel()),
        offered=flags,
    )


def _grouped(array: NDArray[Any], channels: int, filling: int) -> NDArray[Any]:
    """(rows, tracks) as (groups * rows, channels): groups of tracks in succession, the last filled up."""
    rows, tracks = array.shape
    groups = -(-tracks // channels)
    wide = np.full((rows, groups * channels), filling, array.dtype)
    wide[:, :tracks] = array
    return wide.reshape(rows, groups, channels).swapaxes(0, 1).reshape(groups * rows, channels)


def from_model(model: Model, typed: TypedGraph | FloatGraph, count: int, channels: int, seed: int) -> Steps:
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
    return Steps(commands=_first(acts, count), inputs=steps.inputs, flags=flags, order=order, offered=flags)


def _first(given: NDArray[np.int8], count: int) -> NDArray[np.int8]:
    flat = given.copy().ravel()
    flat[count:] = Command.NONE
    return flat.reshape(given.shape)


def random_steps(
    typed: TypedGraph | FloatGraph,
    count: int,
    channels: int,
    seed: int,
    *,
    in_turn: bool = False,
    few: bool = False,
) -> Steps:
    """``count`` steps of raw numbers from anywhere in their formats.

    Tracks come in random order, or ``in_turn``; of ``few`` tracks, these are the first and the last.
    """
    random = np.random.default_rng(seed)
    tracks = np.arange(count) % channels if in_turn else _tracks(random, count, channels)
    if few:
        tracks = (tracks % 2) * (channels - 1)
    turn = _turns(tracks)
    shape = (int(turn.max()) + 1, channels)
    order = turn * channels + tracks
    active = np.zeros(shape, bool)
    active.ravel()[order] = True
    drawn = random.random(shape)
    given = np.where(drawn < _INITIALISE + _PREDICT, Command.PREDICT, Command.UPDATE).astype(np.int8)
    given[drawn < _INITIALISE + _FOURTH] = FOURTH
    given[drawn < _INITIALISE] = Command.INITIALISE
    given[~active] = Command.NONE
    measured = (given == Command.INITIALISE) | (given == Command.UPDATE)
    inputs, offered = {}, {}
    for operation, form in zip(typed.graph.operations, typed.formats, strict=True):
        if isinstance(operation, Input):
            assert form is not None
            inputs[operation.name] = _anywhere(random, form, shape)
        elif isinstance(operation, Flag) and operation.name != "initialise":
            offered[operation.name] = random.random(shape) >= _MISSED
    flags = {"initialise": given == Command.INITIALISE} | {n: seen & measured for n, seen in offered.items()}
    inputs |= coefficient_inputs(typed, shape)
    return Steps(commands=given, inputs=inputs, flags=flags, order=order, offered=offered)


def walking(
    typed: TypedGraph, walks: Sequence[Walk], channels: int, seed: int, *, calm: bool = False
) -> Steps:
    """Walks one after the other on every track, tracks in turn.

    Raw numbers come from anywhere, and flags that a walk leaves open are drawn. ``calm``: all numbers are
    zero and all measurements there, so that nothing hides what the walk itself brings about.
    """
    random = np.random.default_rng(seed)
    lengths = [sum(map(len, walks[track::channels])) for track in range(channels)]
    shape = max(lengths), channels
    given = np.full(shape, Command.NONE, np.int8)
    numbers = zip(typed.graph.operations, typed.formats, strict=True)
    inputs = {
        operation.name: np.zeros(shape, np.int64) if calm else _anywhere(random, form, shape)
        for operation, form in numbers
        if isinstance(operation, Input) and form is not None
    }
    inputs |= coefficient_inputs(typed, shape)
    names = [op.name for op in typed.graph.operations if isinstance(op, Flag) and op.name != "initialise"]
    offered = {name: random.random(shape) >= (0 if calm else _MISSED) for name in names}
    for track in range(channels):
        row = 0
        for walk in walks[track::channels]:
            place = slice(row, row := row + len(walk)), track
            given[place] = np.where(walk.flags["initialise"], Command.INITIALISE, Command.UPDATE)
            for name, seen in walk.flags.items():
                if name != "initialise":
                    offered[name][place] = seen
    measured = given != Command.NONE
    flags = {"initialise": given == Command.INITIALISE} | {n: seen & measured for n, seen in offered.items()}
    order = np.flatnonzero(measured.ravel())
    return Steps(commands=given, inputs=inputs, flags=flags, order=order, offered=offered)


# Steps in succession that follow one pattern of tracks, at most.
_PIECE = 60


def _tracks(random: np.random.Generator, count: int, channels: int) -> NDArray[np.int64]:
    """Tracks of steps: pieces at random, pieces in turn, one track again and again, a few that alternate."""
    pieces, missing = [], count
    while missing > 0:
        length = min(missing, int(random.integers(1, _PIECE, endpoint=True)))
        few = int(random.choice([1, 2, 3, channels, channels]))
        chosen = random.choice(channels, min(few, channels), replace=False)
        turns = np.arange(length) % len(chosen)
        piece = chosen[turns] if random.random() < 0.5 else random.choice(chosen, length)
        pieces.append(piece)
        missing -= length
    return np.concatenate(pieces).astype(np.int64)


def _turns(tracks: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many steps of the same track stand before each step."""
    order = np.argsort(tracks, kind="stable")
    ranked = tracks[order]
    first = np.searchsorted(ranked, ranked)
    turns = np.empty(len(tracks), np.int64)
    turns[order] = np.arange(len(tracks)) - first
    return turns


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Steps between two resets, and how the streams pause.

    ``blocked``: no result is taken before the hardware is full. ``left``: so many results of each stream are
    still on the way when the reset comes that ends the section, or one where it has no more than so many:
    before its first result the entrance may be full.
    """

    steps: Steps
    stalls: Stalls = field(default_factory=Stalls)
    blocked: bool = False
    left: int = 0

    @property
    def calm(self) -> bool:
        """Whether nobody pauses, so that it is known when each result comes."""
        return not (self.blocked or self.stalls.source or self.stalls.sink)


# Sections that a reset ends in the middle, their steps, and how many of them come before one that fills the
# hardware up; and the share of all steps that they may take.
_SHORT, _SHORT_STEPS, _FILLING, _SHARE = 60, 30, 5, 2
# Of the short sections, those at the full rate.
_IN_TURN = 0.3


def random_sections(
    plan: Plan, shown: Interface, count: int, seed: int, loaded: TypedGraph | FloatGraph | None = None
) -> tuple[Section, ...]:
    """``count`` random steps: short sections that resets end, some that fill the hardware, two long ones.

    One of the long sections never pauses. ``loaded`` is the plan's graph with other coefficients.
    """
    typed = loaded or plan.typed
    clocks, streams, tracks = clocks_of(plan, shown), len(shown.streams), plan.channels * shown.lanes
    full = clocks.held_back
    random = np.random.default_rng(seed)
    filling = (full + _SHORT_STEPS) * streams
    group = _FILLING * _SHORT_STEPS * streams + filling
    sections: list[Section] = []
    for _ in range(min(_SHORT // _FILLING, count // _SHARE // group)):
        sections += [_short(typed, clocks, tracks, streams, random) for _ in range(_FILLING)]
        # Tracks in turn, so that steps wait for a place only.
        steps = random_steps(typed, filling, tracks, _seed(random), in_turn=True)
        sections.append(Section(steps=steps, blocked=True))
    rest = count - sum(len(section.steps.order) for section in sections)
    pauses = Stalls(), Stalls(seed=seed, source=_STALLS[0], sink=_STALLS[0])
    for size, stalls in zip((rest // 2, rest - rest // 2), pauses, strict=True):
        if size:
            steps = random_steps(typed, size, tracks, _seed(random))
            sections.append(Section(steps=steps, stalls=stalls))
    return tuple(sections)


def _short(
    typed: TypedGraph | FloatGraph,
    clocks: Clocks,
    tracks: int,
    streams: int,
    random: np.random.Generator,
) -> Section:
    """Some steps, of all tracks or of two, the same in all such sections, that may meet before and after."""
    if clocks.never_waits and random.random() < _IN_TURN:
        # At the full rate every register holds a step when the reset comes.
        left = int(random.integers(0, clocks.in_full_flow, endpoint=True))
        size = (left + _SHORT_STEPS) * streams
        steps = random_steps(typed, size, tracks, _seed(random), in_turn=True)
        return Section(steps=steps, left=left)
    source, sink = random.choice((0.0, *_STALLS), 2) if random.random() < 0.5 else (0.0, 0.0)
    stalls = Stalls(seed=_seed(random), source=float(source), sink=float(sink))
    left = int(random.integers(0, clocks.on_the_way(steady=not source), endpoint=True))
    least = left + 1 if left > 1 else left
    size = int(random.integers(least, 2 * _SHORT_STEPS - left, endpoint=True)) * streams or 1
    steps = random_steps(typed, size, tracks, _seed(random), few=bool(random.random() < 0.5))
    return Section(steps=steps, stalls=stalls, left=left)


def _seed(random: np.random.Generator) -> int:
    return int(random.integers(1 << 32))


# Of random numbers in floating point, those whose exponents are anywhere, and those at the limits.
_FAR, _LIMITS = 0.03, 0.02


def _floats(random: np.random.Generator, form: Float, shape: tuple[int, int]) -> Integers:
    """Encoded numbers: as a rule near one; some anywhere, not numbers among them, some at the limits."""
    anywhere = _any_bits(random, form.width, shape)
    spread = min(form.bias, 1 + form.mantissa // 2)
    exponents = form.bias + random.integers(-spread, spread, shape).astype(object)
    fraction = anywhere & ((1 << form.mantissa) - 1)
    near = exponents << form.mantissa | fraction | anywhere & form.sign
    limits = [0, form.sign, 1, 1 << form.mantissa, form.highest, form.infinity, form.nan, form.nan | 1]
    kind = random.random(shape)
    drawn = np.where(kind < _FAR + _LIMITS, anywhere, near)
    drawn = np.where(kind < _LIMITS, random.choice(np.array(limits, object), shape), drawn)
    return np.asarray(drawn.astype(np.uint64) if form.width <= 64 else drawn)


def _any_bits(random: np.random.Generator, width: int, shape: tuple[int, int]) -> Integers:
    """Python integers of so many bits, each of them drawn."""
    bits = random.integers(0, 2, (*shape, width)).astype(object)
    # Of a list of them NumPy may make floats.
    return np.asarray((bits * np.array([1 << k for k in range(width)], object)).sum(axis=-1))


def _anywhere(random: np.random.Generator, form: Fixed | Float, shape: tuple[int, int]) -> Integers:
    """Raw integers: half of them anywhere, a quarter small, a quarter at the limits."""
    if isinstance(form, Float):
        return _floats(random, form, shape)
    if form.width > 62:
        return np.asarray(_any_bits(random, form.width, shape) + form.lowest)
    anywhere = random.integers(form.lowest, form.highest, shape, endpoint=True)
    small = anywhere >> (form.width // 2)
    limits = np.where(random.random(shape) < 0.5, form.lowest, form.highest)
    kind = random.random(shape)
    return np.where(kind < 0.5, anywhere, np.where(kind < 0.75, small, limits))
