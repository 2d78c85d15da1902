"""Linear models whose F, Q, R, B and offset are formulas in run-time inputs, such as the time dt of a step.

x(k) = F(u) x(k-1) + B(u) c + offset(u) + w,   w ~ N(0, Q(u))
z(k) = H x(k) + measurement_offset + v,         v ~ N(0, R(u))

where u (p,) are the step's controls c and, behind them, its inputs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.graph.signal import Array as Elements
from kalmanhdl.graph.signal import named
from kalmanhdl.model import checks
from kalmanhdl.model.formulas import Formulas, texts
from kalmanhdl.model.inputs import (
    Entries,
    RunTimeInput,
    checked_inputs,
    covariance_formulas,
    matrix_formulas,
    middle,
    points,
    values,
)
from kalmanhdl.model.model import Seen, root
from kalmanhdl.model.state_space import (
    Dynamics,
    Initial,
    InitialRule,
    LinearModel,
    begun,
    checked_initial,
    linear_model,
)
from kalmanhdl.model.units import Units, divided

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VaryingModel:
    """What is estimated. Made by ``varying_model``.

    Formulas over u, in real units: F (n, n), Q (n, n), R (m, m), B (n, p), offset (1, n). ``fixed`` is the
    linear model at the middle of the inputs' limits, in the units of the model; its H, names, ranges and
    start are those of every step.
    """

    kind: ClassVar[str] = "time-varying"
    suited: ClassVar[tuple[str, ...]] = ("conventional", "joseph", "sequential", "bierman_thornton")

    F: Formulas
    Q_formulas: Formulas
    R_formulas: Formulas
    B: Formulas
    offset: Formulas
    fixed: LinearModel
    initial: Initial
    inputs: tuple[RunTimeInput, ...]
    units: Units
    # What a file says of the formulas, by key, and its constants.
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of states."""
        return self.fixed.n

    @property
    def m(self) -> int:
        """Number of measurements."""
        return self.fixed.m

    @property
    def p(self) -> int:
        """Number of controls, inputs among them."""
        return self.fixed.p

    @property
    def Q(self) -> Array:
        """Covariance of the process noise in the middle of the inputs' limits."""
        return self.fixed.Q

    @property
    def R(self) -> Array:
        """Covariance of the measurement noise in the middle of the inputs' limits."""
        return self.fixed.R

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.fixed.state_names

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self.fixed.state_units

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Names of the measurements."""
        return self.fixed.measurement_names

    @property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls and, behind them, of the inputs."""
        return self.fixed.control_names

    @property
    def measurement_range(self) -> Array | None:
        """Declared limits of the measurements."""
        return self.fixed.measurement_range

    @property
    def nis_weight(self) -> Array | None:
        """Weight of each measurement in the normalised innovation squared."""
        return self.fixed.nis_weight

    @property
    def seen(self) -> dict[int, Seen]:
        """The measurements that are one state times a number, plus an offset."""
        return self.fixed.seen

    @property
    def dependence(self) -> NDArray[np.bool_]:
        """Which states each measurement depends on. Shape (m, n)."""
        return self.fixed.dependence

    @property
    def angles(self) -> frozenset[int]:
        """None: a linear measurement counts on past a turn."""
        return frozenset()

    def at(self, u: Elements) -> LinearModel:
        """The linear model of one step, whose matrices hold elements: formulas worked out for u (p,)."""
        d, real = self.units.state, u * self.units.control
        measured = self.units.of_measured(self.dependence)
        spread = divided(np.ones((self.n, self.n)), d, self.units.covariance)
        seen = divided(np.ones((self.m, self.m)), self.units.measurement, measured)
        R = named("inputs: R", self.R_formulas(u=real) * seen)
        changed: dict[str, Any] = {
            "F": named("inputs: F", self.F(u=real) * (d / d[:, None])),
            "Q": named("inputs: Q", self.Q_formulas(u=real) * spread),
            "R": R,
            "B": named("inputs: B", self.B(u=real) * (self.units.control / d[:, None])),
            "offset": named("inputs: offset", self.offset(u=real)[0] / d),
            "initial": replace(self.initial, P=self.initial.covariance(R), from_noise=None),
        }
        return replace(self.fixed, **changed)

    def transition(self, x: Elements, u: Elements) -> Elements:
        """F x + B u + offset."""
        return self.at(u).transition(x, u)

    def observation(self, x: Elements) -> Elements:
        """H x + measurement_offset."""
        return self.fixed.observation(x)

    def start(self, x: Elements, z: Elements, u: Elements) -> tuple[Elements, Elements]:
        """The mean of ``initial``, and its P under the R of the step."""
        return self.at(u).start(x, z, u)

    def measurement_errors(self, u: Array, noise: Array) -> Array:
        """Errors of covariance R(u) from standard normal noise (..., m), for controls u (..., p)."""
        R = rows(self.at(elements(u)).R, u.shape[:-1])
        return np.asarray((np.linalg.cholesky(R) @ noise[..., None])[..., 0])

    def first_states(self, random: np.random.Generator, tracks: int) -> Array:
        """True states (tracks, n) at the first plot; see ``LinearModel``."""
        return self.fixed.first_states(random, tracks)

    def trajectories(self, x: Array, u: Array, noise: Array, random: np.random.Generator) -> Array:
        """True states (steps, tracks, n) that begin with x; see ``model.model.Model``."""
        result = np.empty((len(u), *x.shape))
        result[0] = x
        for k in range(1, len(u)):
            step = self.at(elements(u[k]))
            moved = rows(step.transition(elements(result[k - 1]), elements(u[k])), x.shape[:-1])
            roots = np.stack([root(Q) for Q in rows(step.Q, x.shape[:-1])])
            result[k] = moved + (roots @ noise[k][..., None])[..., 0]
        return result

    def in_units(self, units: Units) -> "VaryingModel":
        """The same model in other units."""
        scale = units.control[self.p - len(self.inputs) :]
        return replace(
            self,
            fixed=self.fixed.in_units(units),
            initial=self.initial.in_units(units),
            inputs=tuple(each.divided(g) for each, g in zip(self.inputs, scale, strict=True)),
            units=units,
        )


def varying_model(
    F: Entries,
    H: ArrayLike,
    Q: Entries,
    R: Entries,
    *,
    inputs: Sequence[RunTimeInput],
    initial: Initial | InitialRule,
    B: Entries | None = None,
    offset: Sequence[float | str] | None = None,
    measurement_offset: ArrayLike | None = None,
    constants: Mapping[str, float] | None = None,
    state_names: Sequence[str] | None = None,
    state_units: Sequence[str] | None = None,
    measurement_names: Sequence[str] | None = None,
    control_names: Sequence[str] = (),
    measurement_range: ArrayLike | None = None,
) -> VaryingModel:
    """A checked model. Entries of F (n, n), Q (n, n), R (m, m), B (n, controls) and offset (n,) are numbers,
    or formulas in inputs and constants: strings or SymPy expressions.

    ``initial`` may rest on H and R, not on what else varies. Q and R are tried at the corners of the inputs'
    limits and at points between.

    Raises:
        ModelError: as ``linear_model``; an input or a formula that cannot be; a Q or R that is no
            covariance somewhere within the limits; a start that rests on F or Q.
    """
    H = checks.array("H", H, (None, None), "H is m x n, a row a measurement")
    (m, n), constants = H.shape, checks.constants(constants)
    states = checks.names("state", state_names, n, "x")
    measured = checks.names("measurement", measurement_names, m, "z")
    controls = checks.listed("control", control_names)
    controls = checks.names("control", controls, len(controls), "u")
    known = checked_inputs(inputs, (*states, *measured, *controls), constants)
    both = (*controls, *(each.name for each in known))
    checks.check_columns(measured, both)
    context = (controls, known, constants)
    drive = [()] * n if B is None else checks.rows("B", B)
    offsets = [0.0] * n if offset is None else checks.listed("offset", offset, "numbers and formulas")
    # No formula names an input's own column of B: what it does stands in the other matrices.
    wide = [[*row, *[0.0] * len(known)] for row in drive]
    found = {
        "F": matrix_formulas("F", F, (n, n), *context),
        "B": matrix_formulas("B", wide, (n, len(both)), *context),
        "offset": matrix_formulas("offset", [offsets], (1, n), *context),
        "Q": covariance_formulas("Q", Q, n, *context, definite=False),
        "R": covariance_formulas("R", R, m, *context, definite=True),
    }
    rule = f"{m} numbers, one a measurement"
    shift = np.zeros(m) if measurement_offset is None else measurement_offset
    shift = checks.array("measurement_offset", shift, (m,), rule)
    linear = _Step(H, shift, states, measured, both, state_units, measurement_range)
    start = _start(linear, found, initial, points(known, len(both)))
    return VaryingModel(
        F=found["F"],
        Q_formulas=found["Q"],
        R_formulas=found["R"],
        B=found["B"],
        offset=found["offset"],
        fixed=linear.model(_at(found, middle(known, len(both))), start),
        initial=start,
        inputs=known,
        units=Units(
            state=np.ones(n), measurement=np.ones(m), control=np.ones(len(both)), covariance=np.ones(n)
        ),
        texts={
            "F": _flat("F", F),
            "Q": _flat("Q", Q),
            "R": _flat("R", R),
            "B": _flat("B", wide),
            "offset": _flat("offset", [offsets]),
        },
        constants=constants,
    )


@dataclass(frozen=True, slots=True)
class _Step:
    """What does not vary from step to step."""

    H: Array
    measurement_offset: Array
    states: tuple[str, ...]
    measured: tuple[str, ...]
    controls: tuple[str, ...]
    units: Sequence[str] | None
    limits: ArrayLike | None

    def model(self, at: Mapping[str, Array], initial: Initial) -> LinearModel:
        """The linear model of a step."""
        return linear_model(
            at["F"],
            self.H,
            at["Q"],
            at["R"],
            B=at["B"],
            offset=at["offset"][0],
            initial=initial,
            measurement_offset=self.measurement_offset,
            state_names=self.states,
            state_units=self.units,
            measurement_names=self.measured,
            control_names=self.controls,
            measurement_range=self.limits,
        )

    def dynamics(self, at: Mapping[str, Array]) -> Dynamics:
        """What a rule makes a start of."""
        return Dynamics(
            F=at["F"],
            H=self.H,
            Q=at["Q"],
            R=at["R"],
            B=at["B"],
            offset=at["offset"][0],
            measurement_offset=self.measurement_offset,
            state_names=self.states,
        )


def _at(found: Mapping[str, Formulas], u: Array) -> dict[str, Array]:
    return {key: next(values(key, formulas, u[None]))[1] for key, formulas in found.items()}


def _start(step: _Step, found: Mapping[str, Formulas], given: Initial | InitialRule, us: Array) -> Initial:
    """A start that is the same whatever the inputs are, but for the R that it may rest on."""
    n, m, p = len(step.states), len(step.measured), len(step.controls)
    first, *others = [begun(given, step.dynamics(_at(found, u))) for u in us]
    keys = ("x", "P", "from_measurement", "from_state", "from_control")
    for other in others:
        if not all(np.array_equal(getattr(first, key), getattr(other, key)) for key in keys):
            problem = ": this start rests on what varies from step to step: give the belief for the first row"
            raise checks.fault("initial.kind", f'{problem}, by kind = "given", or "affine"')
    return checked_initial(first, n, m, p)


def _flat(key: str, rows: Entries) -> tuple[str, ...]:
    return texts(key, [entry for row in rows for entry in row])
