"""How large the numbers of a step become: every operation observed over simulated tracks."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.graph.operations import (
    And,
    Constant,
    Flag,
    Graph,
    Input,
    Not,
    Or,
    Select,
    State,
    is_flag,
    operands,
)
from kalmanhdl.model import inputs
from kalmanhdl.model.model import Model, within_turn

Array = NDArray[np.float64]

STEPS, TRACKS, SEED = 64, 256, 1960
# Half of the tracks miss nothing; of the rest half misses all it may, and half one component in five.
_MISSED = 0.2
# How often tracks are made slower, by a factor of four, until so many of a few stay in their ranges.
_SLOWER, _SAMPLE, _MOST = 12, 32, 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Plots:
    """Simulated or real data of many tracks, all started by ``points`` commands ``initialise``.

    z (steps, tracks, m), u (steps, tracks, p), valid (steps, tracks, m), relevant (steps, tracks).
    """

    z: Array
    u: Array
    valid: NDArray[np.bool_]
    relevant: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranges:
    """The least and greatest value of each operation, in the graph's own units.

    Those of ``declared`` operations are limits that the model declares, and whoever drives it keeps.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    declared: frozenset[int] = frozenset()

    def never_negative(self, index: int) -> bool:
        """Whether it is declared that a value is 0 or more."""
        return index in self.declared and self.low[index] >= 0


def simulated(
    model: Model,
    coast: int,
    steps: int = STEPS,
    tracks: int = TRACKS,
    seed: int = SEED,
    *,
    slow: bool = False,
) -> Plots:
    """Tracks drawn from the model: truth with its noise, plots with theirs, and missed ones among them.

    No component is missed more than ``coast`` times in a row, and in some tracks all are so often.
    A track counts for as long as its plots stay within the model's declared ranges. Controls, whose law
    the model does not know, are standard normal in the units of the model. ``slow`` ones stay in the ranges
    where they can; see ``unhurried``.
    """
    random = np.random.default_rng(seed)
    pace = unhurried(model, steps) if slow else 1.0
    drawn_tracks = drawn(model, random, steps, tracks, pace)
    return Plots(
        z=drawn_tracks.z,
        u=drawn_tracks.u,
        valid=missed_now_and_then(model, random, steps, tracks, coast),
        relevant=drawn_tracks.relevant,
    )


def of_all_ages(model: Model, coast: int) -> Plots:
    """The tracks that ranges rest on: some as the start lets expect, and slow ones, which grow old."""
    lively = simulated(model, coast)
    if not _free(model).any():
        return lively
    slow = simulated(model, coast, slow=True)
    return Plots(
        **{
            field.name: np.concatenate([getattr(lively, field.name), getattr(slow, field.name)], axis=1)
            for field in fields(Plots)
        }
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """Tracks drawn from a model: truth (steps, tracks, n), and z, u, relevant as in ``Plots``."""

    truth: Array
    z: Array
    u: Array
    relevant: NDArray[np.bool_]


def drawn(
    model: Model, random: np.random.Generator, steps: int, tracks: int, pace: Array | float = 1.0
) -> Drawn:
    """Tracks of a model, its noise and its measurements' noise drawn from ``random``; see ``simulated``.

    Their first states are multiplied by ``pace`` (tracks, n).
    """
    x = model.first_states(random, tracks) * pace
    u, noise = np.zeros((steps, tracks, model.p)), np.zeros((steps, tracks, len(model.Q)))
    error = np.zeros((steps, tracks, model.m))
    controls = model.p - len(model.inputs)
    for k in range(steps):
        u[k, :, :controls] = random.standard_normal((tracks, controls))
        if k:
            noise[k] = random.standard_normal((tracks, len(model.Q)))
        error[k] = random.standard_normal((tracks, model.m))
    if model.inputs:
        u[..., controls:] = inputs.drawn(model.inputs, random, steps, tracks)
    error = model.measurement_errors(u, error)
    truth = model.trajectories(x, u, noise, random)
    z = within_turn(model, rows(model.observation(elements(truth)), (steps, tracks)) + error)
    relevant = np.ones((steps, tracks), bool)
    if model.measurement_range is not None:
        low, high = model.measurement_range.T
        inside = np.all((z >= low) & (z <= high), axis=2)
        relevant = np.logical_and.accumulate(inside, axis=0)
    return Drawn(truth=truth, z=z, u=u, relevant=relevant)


def unhurried(model: Model, steps: int) -> Array:
    """What first states (n,) are multiplied by so that most tracks stay in the ranges for so many steps.

    A start from noisy plots gives rates with errors so large that a target as fast as these is gone after
    a few steps, and how a settled filter computes is never seen. How good such a start is does
    not depend on how fast the target is, so that the model leaves this open.
    """
    pace, free, before = np.ones(model.n), _free(model), -1
    for _ in range(_SLOWER if free.any() else 0):
        relevant = drawn(model, np.random.default_rng(SEED), steps, _SAMPLE, pace).relevant
        there = int(relevant.sum())
        if relevant[-1].mean() >= _MOST or there <= before:
            break
        before = there
        pace[free] /= 4.0
    return pace


def _free(model: Model) -> NDArray[np.bool_]:
    """The states that no measurement shows, and that a start computes from plots: any truth is as good."""
    if model.measurement_range is None:
        return np.zeros(model.n, bool)
    low, high = model.measurement_range.T
    z, nothing = low + np.array([[0.3], [0.6]]) * (high - low), np.zeros((2, model.n))
    with np.errstate(all="ignore"):
        mean, _ = model.start(elements(nothing), elements(z), elements(np.zeros((2, model.p))))
    first, second = rows(mean, (2,))
    return np.asarray((first != second) & ~model.dependence.any(axis=0))


def observed(graph: Graph, model: Model, plots: Plots) -> Ranges:
    """The range of every operation of the graph of ``model`` over plots.

    What ``initialise`` computes counts only in the last of a track's starting commands, everything else
    only afterwards: before that, the values are of no meaning.
    """
    steps, tracks = plots.relevant.shape
    starting, running = _cones(graph)
    low, high = np.full(len(graph.operations), np.inf), np.full(len(graph.operations), -np.inf)
    state = {name: np.zeros(tracks) for name, _ in graph.states}
    points = model.initial.points
    for k in range(steps):
        leaves = _leaves(state, plots, k, initialise=k < points)
        with np.errstate(all="ignore"):
            values = evaluate(graph, leaves)
        if k >= points - 1:
            _widen(low, high, values, plots.relevant[k], starting if k < points else running)
        state = {name: np.broadcast_to(values[root], tracks) for name, root in graph.states}
    _hold_starts(graph, low, high)
    declared = _declared(graph, model)
    for index, each in declared.items():
        low[index], high[index] = each.low, each.high
    known = np.isfinite(low) & np.isfinite(high)
    return Ranges(
        low=tuple(np.where(known, low, 0.0)),
        high=tuple(np.where(known, high, 0.0)),
        declared=frozenset(declared),
    )


def _declared(graph: Graph, model: Model) -> dict[int, inputs.RunTimeInput]:
    """The leaves that are run-time inputs."""
    first = model.p - len(model.inputs)
    known = {f"u[{first + k}]": each for k, each in enumerate(model.inputs)}
    leaves = {k: op.name for k, op in enumerate(graph.operations) if isinstance(op, Input)}
    return {index: known[name] for index, name in leaves.items() if name in known}


def _hold_starts(graph: Graph, low: Array, high: Array) -> None:
    """A state holds the constants that it starts with, also where no track counts beyond its start."""
    leaves = {op.name: k for k, op in enumerate(graph.operations) if isinstance(op, State)}
    for name, index in graph.states:
        leaf, stack = leaves.get(name), [index]
        while leaf is not None and stack:
            match graph.operations[stack.pop()]:
                case Select(_, a, b):
                    stack += [a, b]
                case Constant(value):
                    low[leaf], high[leaf] = min(low[leaf], float(value)), max(high[leaf], float(value))
                case _:
                    pass


def _leaves(state: dict[str, Array], plots: Plots, k: int, initialise: bool) -> dict[str, Any]:
    leaves: dict[str, Any] = dict(state)
    leaves |= {f"z[{j}]": np.where(plots.valid[k, :, j], z, 0.0) for j, z in enumerate(plots.z[k].T)}
    leaves |= {f"valid[{j}]": plots.valid[k, :, j] for j in range(plots.z.shape[2])}
    leaves |= {f"u[{i}]": column for i, column in enumerate(plots.u[k].T)}
    return leaves | {"initialise": np.full(plots.z.shape[1], initialise)}


# Operations whose values are looked at together.
_TOGETHER = 1024


def _widen(
    low: Array, high: Array, values: list[Any], relevant: NDArray[np.bool_], numbers: NDArray[np.int64]
) -> None:
    if not relevant.any():
        return
    for part in np.split(numbers, range(_TOGETHER, len(numbers), _TOGETHER)):
        block = np.empty((len(part), len(relevant)))
        for row, index in zip(block, part.tolist(), strict=True):
            row[:] = values[index]
        # A filter that loses its track may divide by zero; what it computes then asks for no format.
        counts = np.isfinite(block) & relevant
        low[part] = np.minimum(low[part], np.where(counts, block, np.inf).min(axis=1))
        high[part] = np.maximum(high[part], np.where(counts, block, -np.inf).max(axis=1))


def _cones(graph: Graph) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The numbers that a step needs under ``initialise``, and those that it needs otherwise."""
    starting, running = (cone(graph, initialise=each) for each in (True, False))
    numbers = {k for k, operation in enumerate(graph.operations) if not is_flag(operation)}
    return np.array(sorted(starting & numbers), np.int64), np.array(sorted(running & numbers), np.int64)


def cone(graph: Graph, *, initialise: bool) -> set[int]:
    """The operations that states and outputs depend on when the command is known."""
    known = _known_flags(graph, initialise)
    seen: set[int] = set()
    stack = list(graph.roots)
    while stack:
        index = stack.pop()
        if index in seen:
            continue
        seen.add(index)
        operation = graph.operations[index]
        chosen = known.get(operation.flag) if isinstance(operation, Select) else None
        if isinstance(operation, Select) and chosen is not None:
            stack.append(operation.a if chosen else operation.b)
        else:
            stack.extend(operands(operation))
    return seen


def _known_flags(graph: Graph, initialise: bool) -> dict[int, bool]:
    """The flags that the command alone decides."""
    known: dict[int, bool] = {}
    for index, operation in enumerate(graph.operations):
        match operation:
            case Flag("initialise"):
                known[index] = initialise
            case Not(a) if a in known:
                known[index] = not known[a]
            case And(a, b) if known.get(a) is False or known.get(b) is False:
                known[index] = False
            case Or(a, b) if known.get(a) is True or known.get(b) is True:
                known[index] = True
            case _:
                pass
    return known


def missed_now_and_then(
    model: Model, random: np.random.Generator, steps: int, tracks: int, coast: int
) -> NDArray[np.bool_]:
    """Which measurements (steps, tracks, m) there are, the others being missed; see ``simulated``.

    Half of the tracks with misses has a plot only after every ``coast`` misses, from the start on: a
    covariance is largest where it had no time to settle.
    """
    valid = np.ones((steps, tracks, model.m), bool)
    half, begin = tracks // 2, steps // 2
    valid[:, half:] = random.random((steps, tracks - half, model.m)) >= _MISSED
    rarely = np.arange(steps) - model.initial.points
    valid[:, half : half + half // 2] = (rarely % (coast + 1) == coast)[:, None, None]
    valid[begin : begin + coast, half + half // 2 :] = False
    # A start from a given belief may well come without a measurement; one from measurements may not.
    valid[: model.initial.points] = not model.initial.before_update
    valid[: model.initial.points, :half] = True
    missed = np.zeros((tracks, model.m), int)
    for row in valid:
        row |= missed >= coast
        missed = np.where(row, 0, missed + 1)
    return valid
