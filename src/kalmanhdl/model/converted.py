"""Linear motion in Cartesian coordinates, of which polar or spherical coordinates are measured.

x(k) = F x(k-1) + B u(k) + offset + w,   w ~ N(0, Q)
z(k) = polar or spherical coordinates of H x(k), + v,   v ~ N(0, R), R diagonal
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.graph.signal import Array as Elements
from kalmanhdl.model import checks
from kalmanhdl.model.conversion import Conversion, Sight, conversion, measured, sight, sight_of
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.model import Seen, driven, root
from kalmanhdl.model.state_space import (
    Dynamics,
    Initial,
    InitialRule,
    LinearModel,
    begun,
    checked_initial,
    linear_model,
)
from kalmanhdl.model.units import Units

Array = NDArray[np.float64]

Coordinates = Literal["polar", "spherical"]
MEASURED: dict[Coordinates, tuple[str, ...]] = {
    "polar": ("range", "bearing"),
    "spherical": ("range", "azimuth", "elevation"),
}
"""What is measured, in this order."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConvertedModel:
    """What is estimated. Made by ``converted_model``.

    ``positions`` is the model of the converted measurements, in the units of ``units``, where a position is
    in the unit of the range; its R stands in for that of the moment, and its start may rest on it
    (``Initial.from_noise``). ``variances`` (m,) of range (m^2) and angles (rad^2) are in real units.
    """

    kind: ClassVar[str] = "converted"
    suited: ClassVar[tuple[str, ...]] = ("converted_measurement",)

    positions: LinearModel
    variances: tuple[float, ...]
    measurement_names: tuple[str, ...]
    units: Units
    measurement_range: Array | None = None

    @property
    def coordinates(self) -> Coordinates:
        """What is measured."""
        return "polar" if self.m == 2 else "spherical"

    @property
    def n(self) -> int:
        """Number of states."""
        return self.positions.n

    @property
    def m(self) -> int:
        """Number of measurements."""
        return self.positions.m

    @property
    def p(self) -> int:
        """Number of controls."""
        return self.positions.p

    @property
    def Q(self) -> Array:
        """Covariance of the process noise."""
        return self.positions.Q

    @property
    def R(self) -> Array:
        """Covariance of the measurement noise, in polar or spherical coordinates."""
        return np.diag(np.array(self.variances) * self.weight / self.units.measurement**2)

    @property
    def initial(self) -> Initial:
        """How a track starts, from converted measurements."""
        return self.positions.initial

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.positions.state_names

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self.positions.state_units

    @property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls."""
        return self.positions.control_names

    @property
    def nis_weight(self) -> Array | None:
        """Weight of each converted coordinate in the normalised innovation squared."""
        return self.positions.nis_weight

    @property
    def inputs(self) -> tuple[RunTimeInput, ...]:
        """None."""
        return ()

    @property
    def seen(self) -> dict[int, Seen]:
        """None: no measurement is a state times a number."""
        return {}

    @property
    def dependence(self) -> NDArray[np.bool_]:
        """Which states each measurement depends on: all on every state of the position. Shape (m, n)."""
        return np.broadcast_to((self.positions.H != 0).any(axis=0), (self.m, self.n))

    @property
    def angles(self) -> frozenset[int]:
        """All measurements but the range."""
        return frozenset(range(1, self.m))

    @property
    def weight(self) -> float:
        """What the covariance of measurements is multiplied by; see ``Units``."""
        return 1.0 / float(self.units.of_measured(self.dependence)[0])

    def transition(self, x: Elements, u: Elements) -> Elements:
        """F x + B u + offset."""
        return self.positions.transition(x, u)

    def observation(self, x: Elements) -> Elements:
        """Polar or spherical coordinates of H x."""
        e = self.units.measurement
        return measured(self.positions.observation(x) * e[0]) / e

    def converted(self, how: Conversion, z: Elements) -> Elements:
        """The position (m,) that measurements say."""
        position: Elements = how.mean(z * self.units.measurement) * (1 / self.units.measurement[0])
        return position

    def covariance(self, how: Conversion, seen: Sight) -> Elements:
        """The covariance (m, m) of a converted measurement of a target that is seen so."""
        return how.covariance(seen, self.weight / float(self.units.measurement[0]) ** 2)

    def sight(self, z: Elements) -> Sight:
        """Where measurements see the target."""
        return sight(z * self.units.measurement)

    def sight_of(self, x: Elements) -> Sight:
        """Where a target of state x is seen."""
        return sight_of(self.positions.observation(x) * self.units.measurement[0])

    def started(self, how: Conversion, x: Elements, z: Elements, u: Elements) -> tuple[Elements, Elements]:
        """Mean (n,) and covariance (n, n) that ``initialise`` makes; all rows count as noisy as the last."""
        position, R = self.converted(how, z), self.covariance(how, self.sight(z))
        return self.initial.mean(x, position, u), self.initial.covariance(R)

    def start(self, x: Elements, z: Elements, u: Elements) -> tuple[Elements, Elements]:
        """Mean and covariance that ``initialise`` makes of debiased measurements."""
        return self.started(conversion(self.variances), x, z, u)

    def measurement_errors(self, u: Array, noise: Array) -> Array:
        """Errors of covariance R from standard normal noise (..., m)."""
        return np.asarray(noise @ root(self.R).T)

    def first_states(self, random: np.random.Generator, tracks: int) -> Array:
        """True states (tracks, n) at the first plot: from the belief, or from anywhere that plots can be."""
        initial = self.initial
        normal = random.standard_normal((tracks, self.n))
        if not initial.takes_measurements:
            return np.asarray(initial.x + normal @ root(initial.P).T)
        assert self.measurement_range is not None
        low, high = self.measurement_range.T
        how, z = conversion(self.variances), elements(low + (high - low) * random.random((tracks, self.m)))
        R = rows(self.covariance(how, self.sight(z)), (tracks,)).mean(axis=0)
        x = initial.x + normal @ root(initial.covariance(R)).T
        position = rows(self.converted(how, z), (tracks,))
        return np.asarray(x + (position - x @ self.positions.H.T) @ np.linalg.pinv(self.positions.H).T)

    def trajectories(self, x: Array, u: Array, noise: Array, random: np.random.Generator) -> Array:
        """True states (steps, tracks, n) that begin with x; see ``model.model.Model``."""
        return driven(self, x, u, noise)

    def in_units(self, units: Units) -> "ConvertedModel":
        """The same model in other units."""
        limits = self.measurement_range
        return replace(
            self,
            positions=self.positions.in_units(
                replace(units, measurement=np.full(self.m, units.measurement[0]))
            ),
            units=units,
            measurement_range=None if limits is None else limits / units.measurement[:, None],
        )


def converted_model(
    F: ArrayLike,
    H: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    initial: Initial | InitialRule,
    B: ArrayLike | None = None,
    offset: ArrayLike | None = None,
    state_names: Sequence[str] | None = None,
    state_units: Sequence[str] | None = None,
    measurement_names: Sequence[str] | None = None,
    control_names: Sequence[str] | None = None,
    measurement_range: ArrayLike | None = None,
) -> ConvertedModel:
    """A checked model. H (2, n) or (3, n) takes the position of state x, of which polar coordinates (range,
    bearing) or spherical ones (range, azimuth, elevation) are measured, with noise of variances R.

    The bearing, in rad, is counted from the first coordinate towards the second, the elevation up from their
    plane. R is diagonal. ``initial`` starts from positions: with ``two_point()`` or ``three_point()`` each
    row is converted first, and P follows from the R of the last one. All else as for ``linear_model``.

    Raises:
        ModelError: as ``linear_model``; an R that is not diagonal; a start from measurements without
            ``measurement_range``, in which the formats of hardware would have no ground.
    """
    H = checks.array("H", H, (None, None), "H is 2 x n or 3 x n, a row a coordinate of the position")
    m = len(H)
    if m not in (2, 3):
        raise checks.fault("H", f" has {m} rows: 2 for polar coordinates, 3 for spherical ones")
    variances = _variances(R, m)
    conversion(variances)
    nowhere = np.zeros((len(H[0]), len(H[0])))
    moves = linear_model(
        F,
        H,
        Q,
        np.eye(m) * variances[0],
        initial=Initial(
            x=nowhere[0],
            from_measurement=nowhere[:, :m],
            from_state=nowhere,
            P=nowhere,
            points=1,
            before_update=True,
        ),
        B=B,
        offset=offset,
        state_names=state_names,
        state_units=state_units,
        measurement_names=MEASURED["polar" if m == 2 else "spherical"]
        if measurement_names is None
        else measurement_names,
        control_names=control_names,
        measurement_range=measurement_range,
    )
    start = checked_initial(_start(moves, initial), moves.n, m, moves.p)
    if start.takes_measurements and moves.measurement_range is None:
        problem = " is missing: a start from measurements needs to know where they may be"
        raise checks.fault("measurement_range", problem)
    return ConvertedModel(
        positions=replace(moves, initial=start, measurement_range=None),
        variances=variances,
        measurement_names=moves.measurement_names,
        units=Units(
            state=np.ones(moves.n),
            measurement=np.ones(m),
            control=np.ones(moves.p),
            covariance=np.ones(moves.n),
        ),
        measurement_range=moves.measurement_range,
    )


def _variances(R: ArrayLike, m: int) -> tuple[float, ...]:
    rule = f"R is {m} x {m}, of {', '.join(MEASURED['polar' if m == 2 else 'spherical'])}"
    matrix = checks.covariance("R", checks.array("R", R, (m, m), rule), definite=True)
    variances = np.diag(matrix)
    if (matrix - np.diag(variances)).any():
        raise checks.fault("R", ": measurements that are converted have independent noises: make R diagonal")
    return tuple(map(float, variances))


def _start(moves: LinearModel, initial: Initial | InitialRule) -> Initial:
    return begun(
        initial,
        Dynamics(
            F=moves.F,
            H=moves.H,
            Q=moves.Q,
            R=moves.R,
            B=moves.B,
            offset=moves.offset,
            measurement_offset=moves.measurement_offset,
            state_names=moves.state_names,
        ),
    )
