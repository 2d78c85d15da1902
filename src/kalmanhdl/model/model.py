"""What the line needs of any model: how it moves, what is measured of it, and how a track starts.

x(k) = transition(x(k-1), u(k)) + w,   w from noise of covariance Q
z(k) = observation(x(k)) + v,          v ~ N(0, R)

``transition``, ``observation`` and ``start`` are written over elements: floats, arrays over samples,
or Signals.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.graph.signal import Array as Elements
from kalmanhdl.math import wrap
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.units import Units

Array = NDArray[np.float64]


class Start(Protocol):
    """The facts of a start that do not depend on data.

    A track starts by ``points`` commands ``initialise`` in a row. With ``before_update`` the result is
    the a priori belief for the row of the last one, which its valid measurements then update.
    """

    @property
    def points(self) -> int:
        """The commands ``initialise`` that a track needs."""

    @property
    def before_update(self) -> bool:
        """Whether the start makes an a priori belief."""

    @property
    def takes_measurements(self) -> bool:
        """Whether the start needs rows whose measurements are complete."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """A measurement of one state alone: z = factor * x[state] + offset, in the model's units."""

    state: int
    factor: float
    offset: float


class Model(Protocol):
    """What is estimated, as the line from the algorithm to the report sees it. A frozen dataclass.

    ``kind`` is its word in messages, ``suited`` the algorithms to use in place of one that does not suit.
    Shapes: Q (q, q), R (m, m), measurement_range (m, 2), nis_weight (m,).
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    kind: ClassVar[str]
    suited: ClassVar[tuple[str, ...]]

    @property
    def n(self) -> int:
        """Number of states."""

    @property
    def m(self) -> int:
        """Number of measurements."""

    @property
    def p(self) -> int:
        """Number of controls."""

    @property
    def Q(self) -> Array:
        """Covariance of the process noise, over whatever number of noises the model has."""

    @property
    def R(self) -> Array:
        """Covariance of the measurement noise."""

    @property
    def initial(self) -> Start:
        """How a track starts."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states."""

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states, empty where not known."""

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Names of the measurements: columns of data."""

    @property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls: columns of data."""

    @property
    def measurement_range(self) -> Array | None:
        """Declared limits of the measurements, or None: formats then rest on simulation."""

    @property
    def nis_weight(self) -> Array | None:
        """Weight of each measurement in the normalised innovation squared, None for all one."""

    @property
    def inputs(self) -> tuple[RunTimeInput, ...]:
        """The run-time inputs, which are the last of the controls."""

    @property
    def seen(self) -> dict[int, Seen]:
        """The measurements that are one state times a number, plus an offset."""

    @property
    def dependence(self) -> NDArray[np.bool_]:
        """Which states each measurement depends on. Shape (m, n)."""

    @property
    def angles(self) -> frozenset[int]:
        """The measurements that are angles in rad, known but for whole turns."""

    def transition(self, x: Elements, u: Elements) -> Elements:
        """The next state (n,) without noise."""

    def observation(self, x: Elements) -> Elements:
        """The measurements (m,) of a state without noise."""

    def start(self, x: Elements, z: Elements, u: Elements) -> tuple[Elements, Elements]:
        """Mean (n,) and covariance (n, n) that ``initialise`` makes of z, u and the state kept before."""

    def measurement_errors(self, u: Array, noise: Array) -> Array:
        """Errors of the measurements (..., m) from standard normal noise (..., m), under u (..., p)."""

    def first_states(self, random: np.random.Generator, tracks: int) -> Array:
        """True states (tracks, n) at the first plot, as the start and the declared ranges let expect."""

    def trajectories(self, x: Array, u: Array, noise: Array, random: np.random.Generator) -> Array:
        """True states (steps, tracks, n) that begin with x (tracks, n).

        Under controls u (steps, tracks, p) and standard normal noise (steps, tracks, q); what else is
        left to chance is drawn from ``random``.
        """

    def in_units(self, units: Units) -> "Model":
        """The same model in other units."""


def within_turn(model: Model, z: Array) -> Array:
    """Measurements (..., m), angles brought within half a turn of the middle of their declared range."""
    result = z.copy()
    for j in model.angles:
        middle = 0.0 if model.measurement_range is None else model.measurement_range[j].mean()
        result[..., j] = middle + wrap(z[..., j] - middle)
    return result


def driven(model: Model, x: Array, u: Array, noise: Array) -> Array:
    """The ``trajectories`` of a model whose noise is added to its state: q = n."""
    result = np.empty((len(u), *x.shape))
    result[0] = x
    drift = noise @ root(model.Q).T
    for k in range(1, len(u)):
        moved = model.transition(elements(result[k - 1]), elements(u[k]))
        result[k] = rows(moved, x.shape[:-1]) + drift[k]
    return result


def root(covariance: Array) -> Array:
    """A with A A' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
