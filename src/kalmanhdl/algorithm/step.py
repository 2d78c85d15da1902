"""What every algorithm shares: the belief, the data of a step, prediction and initialisation.

All functions are written over arrays of elements: floats for the reference, arrays over tracks for
Monte Carlo, Signals for the graph of the hardware.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, Condition, both, named, opposite, select, select_all
from kalmanhdl.model.state_space import LinearModel


@dataclass(frozen=True, slots=True)
class Belief:
    """Mean x (n,) and covariance P (n, n)."""

    x: Array
    P: Array


@dataclass(frozen=True, slots=True)
class Given:
    """The data of one step: measurements z (m,), a valid flag for each, controls u (p,), command."""

    z: Array
    valid: tuple[Condition, ...]
    u: Array
    initialise: Condition


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a step gives: the belief, the innovation y (m,) and the normalised innovation squared.

    A missed component has innovation zero and does not count in ``nis``, which is y' S^-1 y over the
    components that are valid.
    """

    belief: Belief
    innovation: Array
    nis: object


Update = Callable[[LinearModel, Belief, Array, tuple[Condition, ...]], Outcome]


def predict(model: LinearModel, belief: Belief, u: Array) -> Belief:
    """The a priori belief, lee1997 eq. 3 and 4: x = F x + B u + offset, P = F P F' + Q."""
    F = model.F.astype(object)
    x = F @ belief.x + model.offset.astype(object)
    if model.p:
        x = x + model.B.astype(object) @ u
    P = symmetric(F @ belief.P @ F.T + model.Q.astype(object))
    return Belief(named("predict: x", x), named("predict: P", P))


def innovation(model: LinearModel, prior: Belief, z: Array, valid: tuple[Condition, ...]) -> Array:
    """y = z - H x - measurement_offset, lee1997 eq. 7, zero where a component is missed."""
    H = model.H.astype(object)
    y = z - H @ prior.x - model.measurement_offset.astype(object)
    for j, flag in enumerate(valid):
        y[j] = select(flag, y[j], 0.0)
    return named("update: y", y)


def step(model: LinearModel, update: Update, belief: Belief, given: Given) -> Outcome:
    """One command on one track: initialise, or predict and then update with what is valid.

    A command ``predict`` is an update in which no component is valid.
    """
    initial = model.initial
    prior = predict(model, belief, given.u)
    start = _start(model, belief, given)
    if initial.before_update:
        outcome = update(model, _either(given.initialise, start, prior), given.z, given.valid)
        posterior = outcome.belief
    else:
        valid = tuple(both(flag, opposite(given.initialise)) for flag in given.valid)
        outcome = update(model, prior, given.z, valid)
        posterior = _either(given.initialise, start, outcome.belief)
    posterior = Belief(named("posterior: x", posterior.x), named("posterior: P", posterior.P))
    return Outcome(posterior, outcome.innovation, outcome.nis)


def _start(model: LinearModel, belief: Belief, given: Given) -> Belief:
    """The belief that ``initialise`` makes; see ``model.state_space.Initial``."""
    initial = model.initial
    x = initial.x.astype(object) + initial.from_measurement.astype(object) @ given.z
    if np.any(initial.from_state):
        x = x + initial.from_state.astype(object) @ belief.x
    if initial.from_control is not None:
        x = x + initial.from_control.astype(object) @ given.u
    return Belief(named("initialise: x", x), initial.P.astype(object))


def _either(condition: Condition, a: Belief, b: Belief) -> Belief:
    return Belief(select_all(condition, a.x, b.x), symmetric(select_all(condition, a.P, b.P)))
