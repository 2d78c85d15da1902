"""The units of the hardware: given by the design, or powers of two that fill the formats."""

import math

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Filter
from kalmanhdl.algorithm.trace import components, trace
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import FormatError
from kalmanhdl.graph.operations import Graph
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.ranges import Plots, Ranges, observed
from kalmanhdl.numerics.scaling import Scaling
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.validation import InvalidValueError

Array = NDArray[np.float64]

# What no state of a filter that works comes to, whatever its unit.
_DIVERGED = 1e40


def units(model: Model, filter_: Filter, specification: FixedSpecification, plots: Plots) -> Scaling:
    """The scaling a design asks for.

    "auto": one unit of a state is the power of two that brings its values over the plots just inside
    the format of states; a measurement of one state shares its unit. The covariance of a component is
    then divided by the variance of its first measurement, so that this measurement has R = 1.

    Raises FormatError where the filter diverges on the plots.
    """
    graph = trace(model, filter_)
    ranges, roots = observed(graph, model, plots), dict(graph.outputs)
    for i, name in enumerate(model.state_names):
        _check_converged(f"state {name}", ranges, roots[f"x[{i}]"], _DIVERGED)
        if f"P[{i},{i}]" in roots:
            _check_converged(f"the variance of {name}", ranges, roots[f"P[{i},{i}]"], _DIVERGED**2)
    if isinstance(specification.scale, tuple):
        state = np.array(specification.scale)
    else:
        state = np.array([_unit(ranges, roots[f"x[{i}]"], specification) for i in range(model.n)])
    measurement = _measurement_units(model, state, plots)
    covariance = _covariance_units(model, components(graph), measurement, specification)
    if not isinstance(specification.scale, tuple):
        state = _roomier(graph, ranges, state, covariance, specification)
        measurement = _measurement_units(model, state, plots)
        covariance = _covariance_units(model, components(graph), measurement, specification)
    control = np.array([_power(float(np.abs(plots.u[..., k]).max())) for k in range(model.p)])
    return Scaling(
        state=state,
        measurement=measurement,
        control=control,
        covariance=covariance,
    )


def _check_converged(what: str, ranges: Ranges, root: int, most: float) -> None:
    reach = max(-ranges.low[root], ranges.high[root])
    if not reach < most:
        problem = f"{what} comes to {reach:.1e} in floats on tracks drawn from the model"
        raise FormatError(
            f"{problem}: the filter diverges; choose another algorithm, or mend the model", table="model"
        )


def _unit(ranges: Ranges, root: int, specification: FixedSpecification) -> float:
    form = specification.form("state")
    reach = float(form.real(form.highest)) if isinstance(form, Fixed) else 1.0
    return _power(max(-ranges.low[root], ranges.high[root]) * 1.25) / _power(reach)


def _roomier(
    graph: Graph, ranges: Ranges, state: Array, covariance: Array, specification: FixedSpecification
) -> Array:
    """Larger units for states whose variance would leave a format that the design gives covariances."""
    form, roots = specification.form("covariance"), dict(graph.outputs)
    if not isinstance(form, Fixed):
        return state
    reach = float(form.real(form.highest))
    enlarged = state.copy()
    for i, unit in enumerate(state):
        if f"P[{i},{i}]" in roots:
            variance = ranges.high[roots[f"P[{i},{i}]"]] / covariance[i]
            enlarged[i] = max(unit, _power(math.sqrt(max(variance, 0.0) / reach)))
    return enlarged


def _power(value: float) -> float:
    """The least power of two not below a value."""
    mantissa, exponent = math.frexp(value)
    return 2.0 ** (exponent - (mantissa == 0.5)) if value > 0 else 1.0


def _measurement_units(model: Model, state: Array, plots: Plots) -> Array:
    def unit(j: int) -> float:
        if j in model.seen:
            return float(state[model.seen[j].state]) * _power(abs(model.seen[j].factor))
        reach = float(np.abs(plots.z[plots.relevant][:, j]).max(initial=0.0))
        # In turns, an angle is wrapped by leaving out bits.
        return _power(reach / math.tau) * math.tau if j in model.angles else _power(reach)

    return np.array([unit(j) for j in range(model.m)])


def _covariance_units(
    model: Model,
    parts: tuple[tuple[str, ...], ...],
    measurement: Array,
    specification: FixedSpecification,
) -> Array:
    asked, groups = specification.covariance_scale, [[int(name[2:-1]) for name in part] for part in parts]
    if asked != "auto":
        given = np.broadcast_to(np.array(asked, float), model.n).copy()
        _check_equal(given, groups, model)
        return given
    result = np.ones(model.n)
    for states in groups:
        seen = np.flatnonzero(model.dependence[:, states].any(axis=1))
        if len(seen):
            result[states] = model.R[seen[0], seen[0]] / measurement[seen[0]] ** 2
    return result


def _check_equal(given: Array, groups: list[list[int]], model: Model) -> None:
    for states in groups:
        if len(set(given[states])) > 1:
            names = ", ".join(model.state_names[i] for i in states)
            problem = f" = {given[states].tolist()} for {names}: equal within states that are coupled"
            raise InvalidValueError("numerics", "covariance_scale", problem)
