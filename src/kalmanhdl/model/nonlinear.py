"""Nonlinear models: x(k) = f(x(k-1), u(k)) + G w, z(k) = h(x(k)) + v, with w ~ N(0, Q) and v ~ N(0, R)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.graph.signal import Array as Elements
from kalmanhdl.graph.signal import named
from kalmanhdl.model import checks
from kalmanhdl.model.expression import RESERVED
from kalmanhdl.model.formulas import Formulas, Given, formulas, texts
from kalmanhdl.model.inputs import (
    RunTimeInput,
    checked_inputs,
    covariance_formulas,
    middle,
    values,
)
from kalmanhdl.model.model import Seen, root
from kalmanhdl.model.state_space import Dynamics, Initial, InitialRule, begun, checked_initial
from kalmanhdl.model.units import Units, divided
from kalmanhdl.validation import as_tuple, nearest, shown

Array = NDArray[np.float64]

Texts = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredInitial:
    """A track starts from the first row that is complete: x := mean(z, u), P := J R J' + P.

    J (n, m) is the derivative of ``mean`` by z: what the measurements say is as good as they are; P
    (n, n) is what they do not say. Source: the first-order transformation of a covariance, Bar-Shalom,
    Li, Kirubarajan 2001, section 1.4.
    """

    mean: Formulas
    slope: Formulas
    P: Array
    points: int = 1
    before_update: bool = False
    takes_measurements: bool = True


@dataclass(frozen=True, slots=True)
class Measured:
    """The start from the first row, as a user gives it: formulas in the measurements, and P (n, n)."""

    x: Given
    P: ArrayLike


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearModel:
    """What is estimated, by formulas over elements. Made by ``nonlinear_model``.

    Shapes: f (n,), h (m,), their derivatives F (n, n) and H (m, n); G (n, q) and Q (q, q), or None and
    (n, n); R (m, m). Formulas are in real units and ``units`` says those that the model is in; matrices
    and the affine start are in the latter.
    """

    kind: ClassVar[str] = "nonlinear"
    suited: ClassVar[tuple[str, ...]] = ("extended",)

    f: Formulas
    h: Formulas
    F: Formulas
    H: Formulas
    G: Formulas | None
    Q: Array
    R: Array
    initial: Initial | MeasuredInitial
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    measurement_names: tuple[str, ...]
    control_names: tuple[str, ...]
    # Measurements and states that are angles in rad, known but for whole turns.
    angles: frozenset[int]
    state_angles: frozenset[int]
    measurement_range: Array | None
    units: Units
    # What a file says of the formulas, by key, and its constants; keys of Python functions are left out.
    texts: Texts = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    nis_weight: Array | None = None
    # The last of the controls, and Q and R where they are formulas in them; Q and R above are then those
    # in the middle of the inputs' limits.
    inputs: tuple[RunTimeInput, ...] = ()
    Q_formulas: Formulas | None = None
    R_formulas: Formulas | None = None

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.state_names)

    @property
    def m(self) -> int:
        """Number of measurements."""
        return len(self.measurement_names)

    @property
    def p(self) -> int:
        """Number of controls."""
        return len(self.control_names)

    @property
    def seen(self) -> dict[int, Seen]:
        """The measurements that are one state times a number, plus an offset."""
        found = {}
        with np.errstate(all="ignore"):
            there = rows(self.observation(elements(np.zeros((1, self.n)))), (1,))[0]
        for j, (slopes, states) in enumerate(zip(self._constant_slopes, self.dependence, strict=True)):
            (seen,) = np.nonzero(states)
            if len(seen) == 1 and np.isfinite(slopes[seen[0]]):
                factor = float(slopes[seen[0]])
                found[j] = Seen(state=int(seen[0]), factor=factor, offset=float(there[j]))
        return found

    @cached_property
    def _constant_slopes(self) -> Array:
        """The elements of H that are numbers, NaN for the others."""
        varying = self.H.dependence("x", self.n).any(axis=1).reshape(self.m, self.n)
        with np.errstate(all="ignore"):
            there = rows(self.observation_slope(elements(np.ones((1, self.n)))), (1,))[0]
        return np.where(varying, np.nan, there)

    @cached_property
    def dependence(self) -> NDArray[np.bool_]:
        """Which states each measurement depends on. Shape (m, n)."""
        return self.h.dependence("x", self.n)

    def transition(self, x: Elements, u: Elements) -> Elements:
        """f(x, u)."""
        return self.f(**self._real(x, u)) / self.units.state

    def transition_slope(self, x: Elements, u: Elements) -> Elements:
        """The derivative of f by x (n, n)."""
        d = self.units.state
        return self.F(**self._real(x, u)) * (d / d[:, None])

    def process_noise(self, x: Elements, u: Elements) -> Elements:
        """The covariance (n, n) of what chance adds to f(x, u)."""
        Q = self._noise(u)
        if self.G is None:
            return Q
        d, c = self.units.state, self.units.covariance
        gain = self.G(**self._real(x, u)).reshape(self.n, len(self.Q)) / (d * np.sqrt(c))[:, None]
        return np.asarray(gain @ Q @ gain.T)

    def _noise(self, u: Elements) -> Elements:
        """Q (q, q) of a step."""
        if self.Q_formulas is None:
            return self.Q.astype(object)
        Q = named("inputs: Q", self.Q_formulas(u=u * self.units.control))
        if self.G is not None:
            return Q
        return Q * divided(np.ones(Q.shape), self.units.state, self.units.covariance)

    def measurement_noise(self, u: Elements) -> Elements:
        """The covariance (m, m) of the measurements of a step."""
        if self.R_formulas is None:
            return self.R.astype(object)
        measured = self.units.of_measured(self.dependence)
        seen = divided(np.ones((self.m, self.m)), self.units.measurement, measured)
        return named("inputs: R", self.R_formulas(u=u * self.units.control) * seen)

    def measurement_errors(self, u: Array, noise: Array) -> Array:
        """Errors of the step's R from standard normal noise (..., m), for controls u (..., p)."""
        if self.R_formulas is None:
            return np.asarray(noise @ root(self.R).T)
        R = rows(self.measurement_noise(elements(u)), u.shape[:-1])
        return np.asarray((np.linalg.cholesky(R) @ noise[..., None])[..., 0])

    def observation(self, x: Elements) -> Elements:
        """h(x)."""
        return self.h(x=x * self.units.state) / self.units.measurement

    def observation_slope(self, x: Elements) -> Elements:
        """The derivative of h by x (m, n)."""
        d, e = self.units.state, self.units.measurement
        return self.H(x=x * d) * (d / e[:, None])

    def start(self, x: Elements, z: Elements, u: Elements) -> tuple[Elements, Elements]:
        """Mean and covariance that ``initialise`` makes; see ``Initial`` and ``MeasuredInitial``."""
        initial = self.initial
        if isinstance(initial, Initial):
            return initial.mean(x, z, u), initial.P.astype(object)
        d, e = self.units.state, self.units.measurement
        real = {"z": z * e, "u": u * self.units.control}
        slope = initial.slope(**real) * (e / d[:, None])
        # R is in the units of the measurements' covariances, P in those of the states'.
        measured = self.units.of_measured(self.dependence)
        R = self.measurement_noise(u) * np.sqrt(np.outer(measured, measured))
        spread = np.sqrt(np.outer(self.units.covariance, self.units.covariance))
        P = (slope @ R @ slope.T) / spread + initial.P.astype(object)
        return initial.mean(**real) / d, P

    def first_states(self, random: np.random.Generator, tracks: int) -> Array:
        """True states (tracks, n) at the first plot: from the belief, or from anywhere that plots can be."""
        z = np.zeros((tracks, self.m))
        if self.initial.takes_measurements:
            assert self.measurement_range is not None
            low, high = self.measurement_range.T
            z = low + (high - low) * random.random((tracks, self.m))
        nothing = np.zeros((tracks, self.n)), np.zeros((tracks, self.p))
        mean, _ = self.start(elements(nothing[0]), elements(z), elements(nothing[1]))
        spread = root(self.initial.P)
        return rows(mean, (tracks,)) + random.standard_normal((tracks, self.n)) @ spread.T

    def trajectories(self, x: Array, u: Array, noise: Array, random: np.random.Generator) -> Array:
        """True states (steps, tracks, n) that begin with x; see ``model.model.Model``."""
        result = np.empty((len(u), *x.shape))
        result[0] = x
        for k in range(1, len(u)):
            before, controls = elements(result[k - 1]), elements(u[k])
            drift = self._drift(controls, noise[k])
            moved = rows(self.transition(before, controls), x.shape[:1])
            if self.G is None:
                result[k] = moved + drift
            else:
                gain = rows(self.G(**self._real(before, controls)), x.shape[:1])
                shape = (*x.shape[:1], self.n, len(self.Q))
                result[k] = moved + np.einsum("tnq,tq->tn", gain.reshape(shape), drift) / self.units.state
        return result

    def _drift(self, u: Elements, noise: Array) -> Array:
        """Noise (tracks, q) of the step's Q from standard normal noise."""
        if self.Q_formulas is None:
            return np.asarray(noise @ root(self.Q).T)
        roots = np.stack([root(Q) for Q in rows(self._noise(u), noise.shape[:1])])
        return np.asarray((roots @ noise[..., None])[..., 0])

    def in_units(self, units: Units) -> "NonlinearModel":
        """The same model in other units."""
        measured = units.of_measured(self.dependence)
        initial, limits = self.initial, self.measurement_range
        scale = units.control[self.p - len(self.inputs) :]
        return replace(
            self,
            inputs=tuple(each.divided(g) for each, g in zip(self.inputs, scale, strict=True)),
            Q=divided(self.Q, units.state, units.covariance) if self.G is None else self.Q,
            R=divided(self.R, units.measurement, measured),
            initial=initial.in_units(units)
            if isinstance(initial, Initial)
            else replace(initial, P=divided(initial.P, units.state, units.covariance)),
            measurement_range=None if limits is None else limits / units.measurement[:, None],
            units=units,
            nis_weight=None if np.all(measured == 1.0) else 1.0 / measured,
        )

    def _real(self, x: Elements, u: Elements) -> dict[str, Elements]:
        return {"x": x * self.units.state, "u": u * self.units.control}


def nonlinear_model(
    f: Given,
    h: Given,
    Q: Any,
    R: Any,
    *,
    initial: Initial | InitialRule | Measured,
    state_names: Sequence[str],
    measurement_names: Sequence[str],
    control_names: Sequence[str] = (),
    inputs: Sequence[RunTimeInput] = (),
    constants: Mapping[str, float] | None = None,
    G: Sequence[Sequence[Any]] | Array | None = None,
    angles: Sequence[str] = (),
    state_units: Sequence[str] | None = None,
    measurement_range: ArrayLike | None = None,
) -> NonlinearModel:
    """A checked model from formulas.

    f is n formulas in states, controls and constants, h is m in states and constants, each a list of
    strings, SymPy expressions and numbers, or a Python function: f(x), f(x, u) where there are controls,
    and h(x), over arrays of elements, which computes with + - * / ** and ``kalmanhdl.math``. Q (n, n) is
    added to the state, or, with G (n, q), Q (q, q) is the covariance of a noise that enters by G, whose
    elements may be numbers and formulas as those of f. R is (m, m). ``angles`` are names of measurements
    and states in rad, known but for whole turns. ``inputs`` are run-time inputs: f and G name them as
    controls, and entries of Q and R may be formulas in them.

    Raises:
        ModelError: names, formulas, shapes, covariances, a start that cannot be.
    """
    states = _named("state", state_names, checks.MAX_STATES)
    measured = _named("measurement", measurement_names, checks.MAX_MEASUREMENTS)
    controls = checks.listed("control", control_names)
    controls = checks.names("control", controls, len(controls), "u")
    constants = checks.constants(constants)
    f, h = _entries(f), _entries(h)
    if isinstance(initial, Measured):
        initial = replace(initial, x=_entries(initial.x))
    known = checked_inputs(inputs, (*states, *measured, *controls), constants)
    context = (controls, known, constants)
    controls = (*controls, *(each.name for each in known))
    checks.check_columns(measured, controls)
    _check_names(states, measured, controls, constants)
    n, m = len(states), len(measured)
    moving = {"x": states, "u": controls}
    f_formulas = formulas("f", f, n, moving, constants)
    h_formulas = formulas("h", h, m, {"x": states}, constants)
    varying_Q = _varying("Q", Q, n if G is None else len(as_tuple(Q) or ()), context, definite=False)
    varying_R = _varying("R", R, m, context, definite=True)
    gain, Q = _noise(G, varying_Q.fixed, n, moving, constants, keep=varying_Q.formulas is not None)
    R = checks.array("R", varying_R.fixed, (m, m), f"R is {m} x {m}, a row a measurement")
    R = checks.covariance("R", R, definite=True)
    limits = checks.ranges(measurement_range, m)
    return NonlinearModel(
        f=f_formulas,
        h=h_formulas,
        F=f_formulas.jacobian("x", n),
        H=h_formulas.jacobian("x", n),
        G=gain,
        Q=checks.covariance("Q", Q, definite=False),
        R=R,
        initial=_initial(initial, (states, measured, controls), constants, R, limits),
        state_names=states,
        state_units=checks.units(state_units, n),
        measurement_names=measured,
        control_names=controls,
        angles=_angles(angles, measured, states),
        state_angles=_angles(angles, states, measured),
        measurement_range=limits,
        units=Units(
            state=np.ones(n), measurement=np.ones(m), control=np.ones(len(controls)), covariance=np.ones(n)
        ),
        texts=_texts(
            {
                "f": f,
                "h": h,
                "x": initial.x if isinstance(initial, Measured) else (),
                "Q": varying_Q.entries,
                "R": varying_R.entries,
            },
            G,
            gain,
        ),
        constants=constants,
        inputs=known,
        Q_formulas=varying_Q.formulas,
        R_formulas=varying_R.formulas,
    )


@dataclass(frozen=True, slots=True)
class _Covariance:
    """A covariance in numbers, those in the middle of the inputs' limits where it is given by formulas."""

    fixed: Any
    formulas: Formulas | None = None
    entries: Sequence[float | str] = ()


def _varying(
    key: str,
    given: Any,
    size: int,
    context: tuple[Sequence[str], tuple[RunTimeInput, ...], Mapping[str, float]],
    *,
    definite: bool,
) -> _Covariance:
    controls, known, constants = context
    rows = [as_tuple(row) or () for row in as_tuple(given) or ()]
    entries = [entry for row in rows for entry in row]
    if not known or not any(isinstance(entry, str) for entry in entries):
        return _Covariance(given)
    found = covariance_formulas(key, rows, size, controls, known, constants, definite=definite)
    u = middle(known, len(controls) + len(known))
    return _Covariance(next(values(key, found, u[None]))[1], found, entries)


def _named(key: str, names: Sequence[str], most: int) -> tuple[str, ...]:
    given = as_tuple(names)
    if given is None or not 1 <= len(given) <= most:
        raise checks.fault(key, f" = {shown(names)}: a list of 1 to {most} names")
    return checks.names(key, given, len(given), "")


def _entries(given: Given) -> Given:
    """Formulas that are read more than once: a list for whatever yields them once."""
    found = None if callable(given) else as_tuple(given)
    return given if found is None else found


def _check_names(
    states: Sequence[str], measured: Sequence[str], controls: Sequence[str], constants: Mapping[str, float]
) -> None:
    """A name in a formula has one meaning."""
    for key, group in (("state", states), ("measurement", measured), ("control", controls)):
        for name in group:
            if name in RESERVED:
                raise checks.fault(
                    key, f": {name!r} has a meaning of its own in formulas: choose another name"
                )
            if name in constants:
                raise checks.fault(key, f": {name!r} is a constant too: choose another name")
    twice = sorted(set(states) & {*measured, *controls})
    if twice:
        problem = f": {twice[0]!r} is a measurement or a control too: give every one its own name"
        raise checks.fault("state", problem)


def _noise(
    G: Sequence[Sequence[Any]] | Array | None,
    Q: ArrayLike,
    n: int,
    arguments: Mapping[str, Sequence[str]],
    constants: Mapping[str, float],
    *,
    keep: bool,
) -> tuple[Formulas | None, Array]:
    """The gain of the noise where it depends on states or controls, or to ``keep``, and Q, else none and
    G Q G'."""
    if G is None:
        return None, checks.array("Q", Q, (n, n), f"Q is {n} x {n}, a row a state")
    table = [as_tuple(row) or () for row in as_tuple(G) or ()]
    q = len(table[0]) if table else 0
    if len(table) != n or not q or any(len(row) != q for row in table):
        raise checks.fault("G", f" = {shown(G)}: G has {n} rows, one a state, each with one entry a noise")
    gain = formulas("G", [entry for row in table for entry in row], n * q, arguments, constants)
    matrix = checks.array("Q", Q, (q, q), f"Q is {q} x {q}, a row for each of the {q} columns of G")
    if keep or gain.dependence("x", n).any() or gain.dependence("u", len(arguments["u"])).any():
        return gain, matrix
    numbers = gain(x=np.zeros(n), u=np.zeros(len(arguments["u"]))).astype(np.float64).reshape(n, q)
    return None, np.asarray(numbers @ matrix @ numbers.T)


def _initial(
    given: Initial | InitialRule | Measured,
    names: tuple[Sequence[str], Sequence[str], Sequence[str]],
    constants: Mapping[str, float],
    R: Array,
    limits: Array | None,
) -> Initial | MeasuredInitial:
    states, measured, controls = names
    n, m, p = len(states), len(measured), len(controls)
    if isinstance(given, Measured):
        mean = formulas("initial.x", given.x, n, {"z": measured, "u": controls}, constants)
        P = checks.array("initial.P", given.P, (n, n), f"P is {n} x {n}, a row a state")
        found: Initial | MeasuredInitial = MeasuredInitial(
            mean=mean, slope=mean.jacobian("z", m), P=checks.covariance("initial.P", P, definite=False)
        )
    else:
        start = begun(given, _unknown(states, m, p))
        if not np.isfinite(start.x).all():
            problem = (
                ' = "before_first": a nonlinear model has no such start: give the belief for the first row'
            )
            raise checks.fault("initial.at", problem)
        start = checked_initial(start, n, m, p)
        found = replace(start, P=start.covariance(R), from_noise=None)
    if found.takes_measurements and limits is None:
        problem = " is missing: a start from measurements needs it, to know where tracks begin"
        raise checks.fault("measurement_range", problem)
    return found


def _unknown(states: Sequence[str], m: int, p: int) -> Dynamics:
    """Matrices that a nonlinear model has not: what rests on them is no number."""
    n = len(states)
    return Dynamics(
        F=np.full((n, n), np.nan),
        H=np.full((m, n), np.nan),
        Q=np.full((n, n), np.nan),
        R=np.full((m, m), np.nan),
        B=np.full((n, p), np.nan),
        offset=np.full(n, np.nan),
        measurement_offset=np.full(m, np.nan),
        state_names=tuple(states),
    )


def _angles(angles: Sequence[str], names: Sequence[str], others: Sequence[str]) -> frozenset[int]:
    known = {*names, *others}
    given = [angles] if isinstance(angles, str) else checks.listed("angles", angles)
    for name in given:
        if not isinstance(name, str) or name not in known:
            problem = (
                f": {shown(name)} is neither a measurement nor a state: {nearest(str(name), sorted(known))}"
            )
            raise checks.fault("angles", problem)
    return frozenset(place for place, name in enumerate(names) if name in given)


def _texts(given: Mapping[str, Given], G: Any, gain: Formulas | None) -> Texts:
    found = {key: texts(key, each) for key, each in given.items() if not callable(each) and len(each)}
    if gain is not None:
        found["G"] = texts("G", [entry for row in G for entry in row])
    return found
