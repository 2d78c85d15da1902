"""The extended Kalman filter."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.conventional import conventional_correction
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given, unsuited
from kalmanhdl.algorithm.joseph import joseph_correction
from kalmanhdl.algorithm.memory import Kept, Kind, Memory
from kalmanhdl.graph.linear_algebra import symmetric
from kalmanhdl.graph.signal import Array, named, select
from kalmanhdl.math import wrap
from kalmanhdl.model.model import Model
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.validation import flag

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Extended(Algorithm):
    """The conventional filter about the estimate: f and h for the mean, their derivatives for P.

    Source: Bar-Shalom, Li, Kirubarajan 2001, section 10.3.3: x = f(x, u) eq. 10.3.3-5, P = F P F' + Q
    eq. 10.3.3-6 with F at the estimate before, S = H P H' + R eq. 10.3.3-8 with H at the prediction, and
    the update of the linear filter; with ``joseph`` in Joseph's form. The innovation of an angle is
    wrapped to half a turn either side, and so is a state that is an angle.

    Choose it where the noises are small beside the bends of f and h: its covariance knows the slopes
    only. Multiplications of signals: those of f, h and their derivatives, 2 n^2 times what F holds in a
    row for F P F', and those of ``conventional`` (or ``joseph``) for H.
    """

    kind: ClassVar[str] = "extended"
    joseph: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "joseph", flag("algorithm", "joseph", self.joseph))

    def __call__(self, model: Model) -> Filter:
        """The filter of a nonlinear model."""
        if not isinstance(model, NonlinearModel):
            raise unsuited(model, self)
        n = model.n
        return Filter(
            kept=(Kept("x", Kind.STATE, (n,)), Kept("P", Kind.COVARIANCE, (n, n))),
            start=lambda memory, given: _start(model, memory, given),
            predict=lambda memory, given: _predict(model, memory, given),
            update=lambda memory, given: self._update(model, Belief(memory["x"], memory["P"]), given),
            estimate=lambda memory: Belief(memory["x"], memory["P"]),
            before_update=model.initial.before_update,
        )

    def _update(self, model: NonlinearModel, prior: Belief, given: Given) -> Correction:
        y = _innovation(model, prior.x, given)
        H = named("update: H", model.observation_slope(prior.x))
        tangent = _Tangent(model.n, H, model.measurement_noise(given.u), model.nis_weight)
        correct = joseph_correction if self.joseph else conventional_correction
        found = correct(tangent, prior, given.valid, y)
        x = _wrapped(found.memory["x"], model.state_angles, model.units.state)
        found = replace(found, memory={**found.memory, "x": named("update: x", x)})
        if model.initial.before_update:
            return found
        # A start that takes no update has no prior either, about which h could be linearised.
        return replace(found, nis=select(given.initialise, 0.0, found.nis))


@dataclass(frozen=True, slots=True)
class _Tangent:
    """h linearised: see ``gain.Observation``."""

    n: int
    H: Array
    R: Array
    nis_weight: Numbers | None


def _start(model: NonlinearModel, memory: Memory, given: Given) -> Memory:
    x, P = model.start(memory["x"], given.z, given.u)
    x = _wrapped(x, model.state_angles, model.units.state)
    return {"x": named("initialise: x", x), "P": named("initialise: P", symmetric(P))}


def _predict(model: NonlinearModel, memory: Memory, given: Given) -> Memory:
    x, P = memory["x"], memory["P"]
    F = named("predict: F", model.transition_slope(x, given.u))
    noise = model.process_noise(x, given.u)
    return {
        "x": named("predict: x", model.transition(x, given.u)),
        "P": named("predict: P", symmetric(F @ P @ F.T + noise)),
    }


def _innovation(model: NonlinearModel, x: Array, given: Given) -> Array:
    """z - h(x), an angle's to half a turn either side, zero where a component is missed."""
    y = _wrapped(given.z - model.observation(x), model.angles, model.units.measurement)
    for j, valid in enumerate(given.valid):
        y[j] = select(valid, y[j], 0.0)
    return named("update: y", y)


def _wrapped(values: Array, angles: frozenset[int], units: Numbers) -> Array:
    """Values in some units, those of them that are angles brought to half a turn either side."""
    result = values.copy()
    for place in angles:
        result[place] = wrap(values[place] * units[place]) * (1 / units[place])
    return result
