"""Filters that keep the covariance itself: conventional, Joseph and their kin share all but the update."""

from collections.abc import Callable

from kalmanhdl.algorithm.filter import Belief, Correction, Filter, Given
from kalmanhdl.algorithm.memory import Kept, Kind, Memory
from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, named, select
from kalmanhdl.model.state_space import LinearModel

Update = Callable[[Belief, Given], Correction]


def covariance_filter(model: LinearModel, update: Update) -> Filter:
    """The filter that keeps x and P, predicts by the model and updates by ``update``."""
    n = model.n
    return Filter(
        kept=(Kept("x", Kind.STATE, (n,)), Kept("P", Kind.COVARIANCE, (n, n))),
        start=lambda memory, given: {
            "x": start_mean(model, memory["x"], given),
            "P": named("initialise: P", symmetric(model.initial.P.astype(object))),
        },
        predict=lambda memory, given: {
            "x": predict_mean(model, memory["x"], given),
            "P": predict_covariance(model, memory["P"]),
        },
        update=lambda memory, given: update(Belief(memory["x"], memory["P"]), given),
        estimate=lambda memory: Belief(memory["x"], memory["P"]),
        before_update=model.initial.before_update,
    )


def corrected(x: Array, P: Array, y: Array, nis: object) -> Correction:
    """The correction of a filter that keeps x and P."""
    memory: Memory = {"x": named("update: x", x), "P": named("update: P", P)}
    return Correction(memory, y, nis)


def start_mean(model: LinearModel, x: Array, given: Given) -> Array:
    """The mean that ``initialise`` makes of the state kept before; see ``model.state_space.Initial``."""
    return named("initialise: x", model.initial.mean(x, given.z, given.u))


def predict_mean(model: LinearModel, x: Array, given: Given) -> Array:
    """x = F x + B u + offset, lee1997 eq. 3."""
    return named("predict: x", model.transition(x, given.u))


def predict_covariance(model: LinearModel, P: Array) -> Array:
    """P = F P F' + Q, lee1997 eq. 4."""
    F = model.F.astype(object)
    return named("predict: P", symmetric(F @ P @ F.T + model.Q.astype(object)))


def innovation(model: LinearModel, x: Array, given: Given) -> Array:
    """y = z - H x - measurement_offset, lee1997 eq. 7, zero where a component is missed."""
    y = given.z - model.H.astype(object) @ x - model.measurement_offset.astype(object)
    for j, flag in enumerate(given.valid):
        y[j] = select(flag, y[j], 0.0)
    return named("update: y", y)
