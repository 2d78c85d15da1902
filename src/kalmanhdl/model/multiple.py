"""Several linear models of one target, of which one holds at a time and which switch at random."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.graph.signal import Array as Elements
from kalmanhdl.model import checks
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.model import Seen, root
from kalmanhdl.model.state_space import Initial, LinearModel
from kalmanhdl.model.units import Units
from kalmanhdl.validation import shown

Array = NDArray[np.float64]

MAX_MODES = 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MultipleModel:
    """Modes of equal states and measurements, and how they follow each other.

    ``transition_probabilities`` (r, r): in row i, column j the probability that mode i is followed by mode j
    in a step; ``probabilities`` (r,): of the modes of a track that starts. Names, ranges and what is said of
    a single model are those of the first mode.
    """

    kind: ClassVar[str] = "multiple"
    suited: ClassVar[tuple[str, ...]] = ("interacting",)

    modes: tuple[LinearModel, ...]
    transition_probabilities: Array
    probabilities: Array

    @property
    def first(self) -> LinearModel:
        """The mode that says what all have in common."""
        return self.modes[0]

    @property
    def n(self) -> int:
        """Number of states."""
        return self.first.n

    @property
    def m(self) -> int:
        """Number of measurements."""
        return self.first.m

    @property
    def p(self) -> int:
        """Number of controls."""
        return self.first.p

    @property
    def Q(self) -> Array:
        """The process noise of the liveliest mode."""
        return max((mode.Q for mode in self.modes), key=lambda Q: float(np.trace(Q)))

    @property
    def R(self) -> Array:
        """The measurement noise of the first mode."""
        return self.first.R

    @property
    def initial(self) -> Initial:
        """How a track starts."""
        return self.first.initial

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.first.state_names

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self.first.state_units

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Names of the measurements."""
        return self.first.measurement_names

    @property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls."""
        return self.first.control_names

    @property
    def measurement_range(self) -> Array | None:
        """Declared limits of the measurements."""
        return self.first.measurement_range

    @property
    def nis_weight(self) -> Array | None:
        """Weight of each measurement in the normalised innovation squared."""
        return self.first.nis_weight

    @property
    def inputs(self) -> tuple[RunTimeInput, ...]:
        """None."""
        return ()

    @property
    def seen(self) -> dict[int, Seen]:
        """The measurements that are one state times a number in every mode."""
        return {
            j: seen
            for j, seen in self.first.seen.items()
            if all(mode.seen.get(j) == seen for mode in self.modes)
        }

    @property
    def dependence(self) -> NDArray[np.bool_]:
        """Which states each measurement depends on, in any mode."""
        return np.asarray(np.any([mode.dependence for mode in self.modes], axis=0))

    @property
    def angles(self) -> frozenset[int]:
        """None: a linear measurement counts on past a turn."""
        return frozenset()

    def transition(self, x: Elements, u: Elements) -> Elements:
        """The next state in the first mode."""
        return self.first.transition(x, u)

    def observation(self, x: Elements) -> Elements:
        """The measurements in the first mode."""
        return self.first.observation(x)

    def start(self, x: Elements, z: Elements, u: Elements) -> tuple[Elements, Elements]:
        """Mean and covariance of the first mode's start."""
        return self.first.start(x, z, u)

    def measurement_errors(self, u: Array, noise: Array) -> Array:
        """Errors of covariance R from standard normal noise (..., m)."""
        return np.asarray(noise @ root(self.R).T)

    def first_states(self, random: np.random.Generator, tracks: int) -> Array:
        """True states (tracks, n) at the first plot."""
        return self.first.first_states(random, tracks)

    def trajectories(self, x: Array, u: Array, noise: Array, random: np.random.Generator) -> Array:
        """True states that switch modes by their probabilities; see ``model.model.Model``."""
        result = np.empty((len(u), *x.shape))
        result[0] = x
        mode = random.choice(len(self.modes), len(x), p=self.probabilities)
        ends = self.transition_probabilities.cumsum(axis=1)
        for k in range(1, len(u)):
            drawn = random.random(len(x))
            mode = np.minimum((drawn[:, None] >= ends[mode]).sum(axis=1), len(self.modes) - 1)
            for j, each in enumerate(self.modes):
                here = mode == j
                moved = result[k - 1, here] @ each.F.T + u[k, here] @ each.B.T + each.offset
                result[k, here] = moved + noise[k, here] @ root(each.Q).T
        return result

    def in_units(self, units: Units) -> "MultipleModel":
        """The same model in other units."""
        return replace(self, modes=tuple(mode.in_units(units) for mode in self.modes))


def multiple_model(
    modes: Sequence[LinearModel], transition: ArrayLike, probabilities: ArrayLike | None = None
) -> MultipleModel:
    """A checked model of r modes; ``probabilities`` default to those that ``transition`` leaves alone.

    Shapes: transition (r, r), rows that sum to one; probabilities (r,).

    Raises:
        ModelError: fewer than two modes or more than 16, modes of different states, measurements or starts,
            probabilities that are none.
    """
    modes = checks.listed("modes", modes, "linear models")
    r = len(modes)
    if not 2 <= r <= MAX_MODES:
        raise checks.fault("modes", f" are {r}: 2 to {MAX_MODES} modes switch")
    first = modes[0]
    for k, mode in enumerate(modes):
        if not isinstance(mode, LinearModel):
            raise checks.fault(f"modes[{k}]", f" = {shown(mode)}: a mode is a linear model")
    for k, mode in enumerate(modes):
        for key, mine, theirs in (
            ("states", first.state_names, mode.state_names),
            ("measurements", first.measurement_names, mode.measurement_names),
            ("controls", first.control_names, mode.control_names),
        ):
            if mine != theirs:
                raise checks.fault(
                    f"modes[{k}]",
                    f" has the {key} {', '.join(theirs)}: all modes have those of the first, "
                    f"{', '.join(mine)}",
                )
        if (
            mode.initial.points != first.initial.points
            or mode.initial.before_update != first.initial.before_update
        ):
            raise checks.fault(f"modes[{k}]", " starts otherwise than the first: all modes start together")
    P = _probabilities(
        "transition", checks.array("transition", transition, (r, r), f"transition is {r} x {r}")
    )
    if probabilities is None:
        mu = _stationary(P)
    else:
        given = checks.array("probabilities", probabilities, (r,), f"{r} numbers, one a mode")
        mu = _probabilities("probabilities", given)
    return MultipleModel(modes=modes, transition_probabilities=P, probabilities=mu)


def _probabilities(key: str, array: Array) -> Array:
    sums = array.sum(axis=-1)
    if array.min() < 0 or np.abs(sums - 1).max() > 1e-6:
        rows = "each row sums" if array.ndim == 2 else "they sum"
        raise checks.fault(key, f" are no probabilities: 0 or more, and {rows} to 1")
    return array


def _stationary(P: Array) -> Array:
    """The probabilities that a step leaves as they are, or nearly so."""
    mu = np.full(len(P), 1 / len(P))
    for _ in range(64):
        P = P @ P
        P /= P.sum(axis=1, keepdims=True)
    result: Array = mu @ P
    result.flags.writeable = False
    return result
