"""Linear time-invariant state-space models and how a track starts.

x(k) = F x(k-1) + B u(k) + offset + w,   w ~ N(0, Q)
z(k) = H x(k) + measurement_offset + v,  v ~ N(0, R)
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from inspect import signature
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.graph.signal import Array as Elements
from kalmanhdl.model import checks
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.model import Seen, driven, root
from kalmanhdl.model.units import Units, divided
from kalmanhdl.validation import KalmanhdlWarning, as_flag, as_integer, shown

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Initial:
    """How the command ``initialise`` starts a track from measurement z and the state x kept before.

        x := x0 + from_measurement z + from_state x + from_control u,   P := P0 + from_noise R from_noise'

    A k-point initialisation (``points = k``) is k such commands in a row: what the earlier ones leave in
    the state, the last one needs. With ``before_update`` the result is the a priori belief for the row
    of the command, which its valid measurements then update; otherwise it is that row's estimate.

    R stands for as many diagonal blocks of the measurements' covariance as ``from_noise`` has columns for,
    one for each row of data that the start rests on. A linear model takes it into P once and for all.

    Shapes: x0 (n,), from_measurement (n, m), from_state (n, n), P (n, n), from_control (n, p) and
    from_noise (n, k m), None for 0.
    """

    x: Array
    from_measurement: Array
    from_state: Array
    P: Array
    points: int
    before_update: bool
    from_control: Array | None = None
    from_noise: Array | None = None

    @property
    def takes_measurements(self) -> bool:
        """Whether the start needs rows whose measurements are complete."""
        return bool(np.any(self.from_measurement))

    def mean(self, x: Elements, z: Elements, u: Elements) -> Elements:
        """The mean (n,) that ``initialise`` makes, over elements."""
        mean: Elements = self.x.astype(object) + self.from_measurement.astype(object) @ z
        if np.any(self.from_state):
            mean = mean + self.from_state.astype(object) @ x
        if self.from_control is not None:
            mean = mean + self.from_control.astype(object) @ u
        return mean

    def covariance(self, R: Elements) -> Elements:
        """The covariance (n, n) that ``initialise`` makes, over elements, of measurements of covariance R."""
        P: Elements = self.P.astype(R.dtype)
        if self.from_noise is not None:
            for k in range(0, self.from_noise.shape[1], len(R)):
                gain = self.from_noise[:, k : k + len(R)].astype(R.dtype)
                P = P + gain @ R @ gain.T
        return P

    def in_units(self, units: Units) -> "Initial":
        """The same start in other units."""
        d, e, g = units.state, units.measurement, units.control
        noise = self.from_noise
        return replace(
            self,
            from_noise=None if noise is None else noise * np.resize(e, noise.shape[1]) / d[:, None],
            x=self.x / d,
            from_measurement=self.from_measurement * e / d[:, None],
            from_state=self.from_state * d / d[:, None],
            P=divided(self.P, d, units.covariance),
            from_control=None if self.from_control is None else self.from_control * g / d[:, None],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dynamics:
    """The checked matrices of a model, from which a rule of ``model.initial`` derives its start."""

    F: Array
    H: Array
    Q: Array
    R: Array
    B: Array
    offset: Array
    measurement_offset: Array
    state_names: tuple[str, ...]

    @property
    def shared(self) -> dict[str, Any]:
        """Its fields by name: a model has them all."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


InitialRule = Callable[[Dynamics], Initial]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearModel:
    """What is estimated. Shapes: F (n, n), H (m, n), Q (n, n), R (m, m), B (n, p), p may be 0.

    However a model is made, it is checked: raises ModelError as ``linear_model``, which fills in what is
    left out.
    """

    kind: ClassVar[str] = "linear"
    suited: ClassVar[tuple[str, ...]] = ("conventional", "joseph")

    F: Array
    H: Array
    Q: Array
    R: Array
    initial: Initial
    B: Array
    offset: Array
    measurement_offset: Array
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    measurement_names: tuple[str, ...]
    control_names: tuple[str, ...]
    # Declared limits, real units, per measurement (m, 2), or None: formats then rest on simulation.
    measurement_range: Array | None = None
    # Weight of each measurement in the normalised innovation squared (m,), where the covariances of
    # decoupled components are in different units; None: all one.
    nis_weight: Array | None = None

    def __post_init__(self) -> None:
        matrices = (self.F, self.Q, self.R, self.B, self.offset)
        if any(isinstance(each, np.ndarray) and each.dtype == object for each in matrices):
            # The model of one step, made of a checked one, holds elements of an algorithm and no numbers.
            return
        for name, value in _checked(self).items():
            object.__setattr__(self, name, value)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.F)

    @property
    def m(self) -> int:
        """Number of measurements."""
        return len(self.H)

    @property
    def p(self) -> int:
        """Number of controls."""
        return int(self.B.shape[1])

    @property
    def inputs(self) -> tuple[RunTimeInput, ...]:
        """None."""
        return ()

    @property
    def seen(self) -> dict[int, Seen]:
        """The measurements that are one state times a number, plus an offset."""
        return {
            j: Seen(state=int(i[0]), factor=float(row[i[0]]), offset=float(self.measurement_offset[j]))
            for j, row in enumerate(self.H)
            if len(i := np.flatnonzero(row)) == 1
        }

    @property
    def dependence(self) -> NDArray[np.bool_]:
        """Which states each measurement depends on. Shape (m, n)."""
        return np.asarray(self.H != 0)

    @property
    def angles(self) -> frozenset[int]:
        """None: a linear measurement counts on past a turn."""
        return frozenset()

    def transition(self, x: Elements, u: Elements) -> Elements:
        """F x + B u + offset."""
        moved: Elements = self.F.astype(object) @ x + self.offset.astype(object)
        if self.p:
            moved = moved + self.B.astype(object) @ u
        return moved

    def observation(self, x: Elements) -> Elements:
        """H x + measurement_offset."""
        return np.asarray(self.H.astype(object) @ x + self.measurement_offset.astype(object))

    def start(self, x: Elements, z: Elements, u: Elements) -> tuple[Elements, Elements]:
        """The mean of ``initial``, and its P."""
        return self.initial.mean(x, z, u), self.initial.P.astype(object)

    def measurement_errors(self, u: Array, noise: Array) -> Array:
        """Errors of covariance R from standard normal noise (..., m)."""
        return np.asarray(noise @ root(self.R).T)

    def first_states(self, random: np.random.Generator, tracks: int) -> Array:
        """True states at the first plot: drawn from the given belief, or anywhere in the declared ranges."""
        initial = self.initial
        x = initial.x + random.standard_normal((tracks, self.n)) @ root(initial.P).T
        if self.measurement_range is None:
            return x
        low, high = self.measurement_range.T
        z = low + (high - low) * random.random((tracks, self.m))
        if initial.before_update:
            return x
        wrong = z - (x @ self.H.T + self.measurement_offset)
        return np.asarray(x + wrong @ np.linalg.pinv(self.H).T)

    def trajectories(self, x: Array, u: Array, noise: Array, random: np.random.Generator) -> Array:
        """True states (steps, tracks, n) that begin with x; see ``model.model.Model``."""
        return driven(self, x, u, noise)

    def in_units(self, units: Units) -> "LinearModel":
        """The same model in other units."""
        d, e, g = units.state, units.measurement, units.control
        measured = units.of_measured(self.dependence)
        limits = self.measurement_range
        return replace(
            self,
            F=self.F * d / d[:, None],
            H=self.H * d / e[:, None],
            Q=divided(self.Q, d, units.covariance),
            R=divided(self.R, e, measured),
            B=self.B * g / d[:, None],
            offset=self.offset / d,
            measurement_offset=self.measurement_offset / e,
            initial=self.initial.in_units(units),
            measurement_range=None if limits is None else limits / e[:, None],
            nis_weight=None if np.all(measured == 1.0) else 1.0 / measured,
        )


def linear_model(
    F: ArrayLike,
    H: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    initial: Initial | InitialRule,
    B: ArrayLike | None = None,
    offset: ArrayLike | None = None,
    measurement_offset: ArrayLike | None = None,
    state_names: Sequence[str] | None = None,
    state_units: Sequence[str] | None = None,
    measurement_names: Sequence[str] | None = None,
    control_names: Sequence[str] | None = None,
    measurement_range: ArrayLike | None = None,
) -> LinearModel:
    """A checked model; ``initial`` is an ``Initial`` or a rule such as ``given(x, P)`` or ``two_point()``.

    Shapes: F (n, n), H (m, n), Q (n, n), R (m, m), B (n, p), offset (n,), measurement_offset (m,),
    measurement_range (m, 2). Symmetric matrices are made exactly so.

    Raises:
        ModelError: a shape, a number that is not finite, an asymmetric matrix, an indefinite Q or P, an R
            that is not positive definite, a name. Warns with ``KalmanhdlWarning`` of unobservable states.
    """
    dynamics = _dynamics(F, H, Q, R, B, offset, measurement_offset, state_names)
    n, m, p = len(dynamics.F), len(dynamics.H), dynamics.B.shape[1]
    start = begun(initial, dynamics)
    _warn_of_unobservable(dynamics)
    return LinearModel(
        **dynamics.shared,
        initial=_settled(checked_initial(start, n, m, p), dynamics.R),
        state_units=checks.units(state_units, n),
        measurement_names=checks.names("measurement", measurement_names, m, "z"),
        control_names=checks.names("control", control_names, p, "u"),
        measurement_range=checks.ranges(measurement_range, m),
    )


def _dynamics(
    F: ArrayLike,
    H: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    B: ArrayLike | None,
    offset: ArrayLike | None,
    measurement_offset: ArrayLike | None,
    state_names: Sequence[str] | None,
) -> Dynamics:
    """The checked matrices. Raises ModelError."""
    F = checks.array("F", F, (None, None), "F is n x n")
    n = F.shape[0]
    if F.shape != (n, n) or n > checks.MAX_STATES:
        rule = f"F is square, with at most {checks.MAX_STATES} states"
        raise checks.fault("F", f" is {n} x {F.shape[1]}: {rule}")
    H = checks.array("H", H, (None, n), f"H is m x {n}, a row a measurement and a column a state")
    m = H.shape[0]
    if m > checks.MAX_MEASUREMENTS:
        raise checks.fault("H", f" has {m} rows: at most {checks.MAX_MEASUREMENTS} measurements")
    return Dynamics(
        F=F,
        H=H,
        Q=checks.covariance("Q", checks.array("Q", Q, (n, n), f"Q is {n} x {n}, as F"), definite=False),
        R=checks.covariance(
            "R", checks.array("R", R, (m, m), f"R is {m} x {m}, a row a measurement"), definite=True
        ),
        B=_control_matrix(B, n),
        offset=_vector("offset", offset, n, "state"),
        measurement_offset=_vector("measurement_offset", measurement_offset, m, "measurement"),
        state_names=checks.names("state", state_names, n, "x"),
    )


def _checked(model: LinearModel) -> dict[str, Any]:
    """The fields of a model as they are kept. Raises ModelError."""
    dynamics = _dynamics(
        *(model.F, model.H, model.Q, model.R, model.B),
        *(model.offset, model.measurement_offset, model.state_names),
    )
    n, m, p = len(dynamics.F), len(dynamics.H), dynamics.B.shape[1]
    measured = checks.names("measurement", model.measurement_names, m, "z")
    controls = checks.names("control", model.control_names, p, "u")
    checks.check_columns(measured, controls)
    weight = model.nis_weight
    return {
        **dynamics.shared,
        "initial": checked_initial(model.initial, n, m, p),
        "state_units": checks.units(model.state_units, n),
        "measurement_names": measured,
        "control_names": controls,
        "measurement_range": checks.ranges(model.measurement_range, m),
        "nis_weight": None if weight is None else _vector("nis_weight", weight, m, "measurement"),
    }


def _control_matrix(B: ArrayLike | None, n: int) -> Array:
    if B is None or (isinstance(B, np.ndarray) and B.shape == (n, 0)):
        empty = np.zeros((n, 0))
        empty.flags.writeable = False
        return empty
    result = checks.array("B", B, (n, None), f"B is {n} x p, a row a state and a column a control")
    if result.shape[1] > checks.MAX_STATES:
        raise checks.fault("B", f" has {result.shape[1]} columns: at most {checks.MAX_STATES} controls")
    return result


def _vector(key: str, value: ArrayLike | None, count: int, what: str) -> Array:
    if value is None:
        value = np.zeros(count)
    return checks.array(key, value, (count,), f"{count} numbers, one a {what}")


def begun(initial: Initial | InitialRule, dynamics: Dynamics) -> Initial:
    """The start that is given, or that a rule makes. Raises ModelError where it is neither."""
    if isinstance(initial, Initial):
        return initial
    rule = "give the result of given(x, P), two_point() or the like"
    try:
        signature(initial).bind(dynamics)
    except (TypeError, ValueError):
        raise checks.fault("initial", f" = {shown(initial)} is no start: {rule}") from None
    found = initial(dynamics)
    if not isinstance(found, Initial):
        raise checks.fault("initial", f" makes {shown(found)}, which is no start: {rule}")
    return found


def checked_initial(start: Initial, n: int, m: int, p: int) -> Initial:
    """A start that suits n states, m measurements and p controls. Raises ModelError."""
    if not isinstance(start, Initial):
        raise checks.fault("initial", f" = {shown(start)} is no start: give an Initial")
    control, noise = start.from_control, start.from_noise
    P = checks.array("initial.P", start.P, (n, n), f"P is {n} x {n}, as F")
    return Initial(
        x=_vector("initial.x", start.x, n, "state"),
        from_measurement=checks.array(
            "initial.from_measurement", start.from_measurement, (n, m), f"from_measurement is {n} x {m}"
        ),
        from_state=checks.array("initial.from_state", start.from_state, (n, n), f"from_state is {n} x {n}"),
        P=checks.covariance("initial.P", P, definite=False),
        points=_checked_points(start.points),
        before_update=_checked_flag(start.before_update),
        from_control=None
        if control is None
        else checks.array("initial.from_control", control, (n, p), f"from_control is {n} x {p}"),
        from_noise=None if noise is None else _checked_noise(noise, n, m),
    )


def _settled(start: Initial, R: Array) -> Initial:
    """The start with the measurements' covariance taken into P."""
    with np.errstate(all="ignore"):
        P = start.covariance(R)
    P = checks.array("initial.P", P, P.shape, "P is finite")
    return replace(start, P=checks.covariance("initial.P", P, definite=False), from_noise=None)


def _checked_noise(noise: Array, n: int, m: int) -> Array:
    rule = f"from_noise is {n} x {m}, or {n} x a multiple of {m}"
    result = checks.array("initial.from_noise", noise, (n, None), rule)
    if result.shape[1] % m or result.shape[1] > 16 * m:
        raise checks.fault("initial.from_noise", f" is {n} x {result.shape[1]}: {rule}, at most 16 times")
    return result


def _checked_points(points: int) -> int:
    found = as_integer(points)
    if found is None or not 1 <= found <= 16:
        raise checks.fault("initial.points", f" = {shown(points)}: an integer from 1 to 16")
    return found


def _checked_flag(before_update: object) -> bool:
    found = as_flag(before_update)
    if found is None:
        raise checks.fault("initial.before_update", f" = {shown(before_update)}: true or false")
    return found


def _warn_of_unobservable(dynamics: Dynamics) -> None:
    hidden = [dynamics.state_names[i] for i in checks.unobservable(dynamics.F, dynamics.H)]
    if hidden:
        warnings.warn(
            f"no sequence of measurements determines {', '.join(hidden)}: "
            "their variance may grow without bound; measure them or leave them out",
            KalmanhdlWarning,
            stacklevel=3,
        )
