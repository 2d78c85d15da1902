"""Float reference and bit-exact engine on the same data."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Filter
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import Input
from kalmanhdl.model.model import Model, within_turn
from kalmanhdl.numerics.floating import FloatGraph, FloatNumbers
from kalmanhdl.numerics.integers import Numbers
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.simulate.commands import Command, commands, started
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.engine import Engine, Trace
from kalmanhdl.simulate.float_arrays import float_raws, float_reals
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.simulate.reference import Estimates, reference

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stimulus:
    """What the hardware is fed: raw integers and flags by name, each (steps, tracks), and the commands.

    ``clipped`` counts the measurements and controls that lay outside their format and were clamped.
    """

    commands: NDArray[np.int8]
    inputs: dict[str, Integers]
    flags: dict[str, NDArray[np.bool_]]
    clipped: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SideBySide:
    """Float reference and hardware on the same plots, NaN where there is nothing to tell.

    ``commands`` (steps, tracks) are what the rows mean; ``valid`` (steps, tracks) tells where there is an
    estimate.
    """

    plots: Plots
    commands: NDArray[np.int8]
    valid: NDArray[np.bool_]
    reference: Estimates
    exact: Estimates


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simulation(SideBySide):
    """Reference and engine of a graph side by side."""

    stimulus: Stimulus
    trace: Trace

    @property
    def saturations(self) -> int:
        """How often a value that matters did not fit its format."""
        return sum(self.trace.violations.values())


def simulate(
    model: Model,
    filter_: Filter,
    numbers: Numbers | FloatNumbers,
    plots: Plots,
    *,
    optimised: bool = True,
) -> Simulation:
    """Run float reference and engine over plots; see ``engine.engines``.

    Raises ToolError where the engine does not compile.
    """
    stimulus = stimulus_of(model, numbers.typed, plots)
    given = stimulus.commands
    valid = started(model, given)
    trace = _run(numbers.typed, stimulus, valid, optimised)
    return Simulation(
        plots=plots,
        commands=given,
        stimulus=stimulus,
        valid=valid,
        reference=where(valid, reference(filter_, given, plots.z, plots.u)),
        exact=where(valid, _estimates(model, filter_, numbers.typed, trace)),
        trace=trace,
    )


def _run(
    typed: TypedGraph | FloatGraph, stimulus: Stimulus, valid: NDArray[np.bool_], optimised: bool
) -> Trace:
    """The engine over all rows; what leaves its format before a track has an estimate does not count."""
    engine, given = Engine.of(typed, optimised=optimised), stimulus.commands
    first = engine.run(
        stimulus.inputs, stimulus.flags, active=(given != Command.NONE) & ~valid, record_states=False
    )
    return engine.run(
        stimulus.inputs, stimulus.flags, active=valid, initial_state=first.final_state, monitor=True
    )


def stimulus_of(model: Model, typed: TypedGraph | FloatGraph, plots: Plots) -> Stimulus:
    """Plots as the hardware takes them, rounded to the nearest raw integer of their formats."""
    given = commands(model, plots.z, plots.active)
    values = {f"z[{j}]": column for j, column in enumerate(np.moveaxis(within_turn(model, plots.z), -1, 0))}
    values |= {f"u[{k}]": plots.u[..., k] for k in range(model.p)}
    inputs, clipped = coefficient_inputs(typed, given.shape), 0
    for index, operation in enumerate(typed.graph.operations):
        if isinstance(operation, Input) and operation.name not in inputs:
            form = typed.formats[index]
            assert form is not None
            real = np.nan_to_num(values[operation.name]) / typed.scales[operation.name]
            inputs[operation.name], outside = raw(real, form)
            clipped += int(np.count_nonzero(outside & (given != Command.NONE)))
    flags = {f"valid[{j}]": ~np.isnan(plots.z[..., j]) & (given != Command.PREDICT) for j in range(model.m)}
    flags["initialise"] = given == Command.INITIALISE
    return Stimulus(commands=given, inputs=inputs, flags=flags, clipped=clipped)


def coefficient_inputs(typed: TypedGraph | FloatGraph, shape: tuple[int, ...]) -> dict[str, Integers]:
    """The coefficients that a graph was made with, the same in every step."""
    raws = typed.coefficients if isinstance(typed, TypedGraph) else {}
    return {
        name: np.full(shape, value, np.int64 if abs(value) < 1 << 62 else object)
        for name, value in raws.items()
    }


def raw(real: Array, form: Fixed | Float) -> tuple[Integers, NDArray[np.bool_]]:
    """The nearest raw integers, ties to even, clamped to the format, and where they had to be clamped.

    Of a floating-point format, as it rounds; what is beyond its numbers is infinite, or the greatest.
    """
    if isinstance(form, Float):
        return float_raws(real, form)
    if form.width > 52:
        exact = np.vectorize(form.nearest, otypes=[object])(real)
        return exact, np.asarray((exact == form.lowest) | (exact == form.highest))
    nearest = np.rint(np.ldexp(real, form.fraction))
    outside = (nearest < form.lowest) | (nearest > form.highest)
    return np.clip(nearest, form.lowest, form.highest).astype(np.int64), outside


def real(raws: Integers, form: Fixed | Float, scale: float) -> Array:
    """Raw integers as real values in the model's units."""
    if isinstance(form, Float):
        return float_reals(raws, form) * scale
    return np.ldexp(np.asarray(raws, np.float64), -form.fraction) * scale


def _estimates(model: Model, filter_: Filter, typed: TypedGraph | FloatGraph, trace: Trace) -> Estimates:
    roots = {**dict(typed.graph.states), **dict(typed.graph.outputs)}

    def values(name: str, raws: Integers) -> Array:
        form = typed.formats[roots[name]]
        assert form is not None
        return real(raws, form, typed.scales[name])

    names = {kept.element(place) for kept in filter_.kept for place in kept.places()} & trace.states.keys()
    P = covariance_of(filter_, {name: values(name, trace.states[name]) for name in names})
    for i in range(model.n):
        P[..., i, i] = values(f"P[{i},{i}]", trace.outputs[f"P[{i},{i}]"])
    x = [values(f"x[{i}]", trace.outputs[f"x[{i}]"]) for i in range(model.n)]
    y = [values(f"innovation[{j}]", trace.outputs[f"innovation[{j}]"]) for j in range(model.m)]
    return Estimates(
        x=np.stack(x, axis=-1),
        P=P,
        innovation=np.stack(y, axis=-1),
        nis=values("nis", trace.outputs["nis"]),
    )


def covariance_of(filter_: Filter, states: dict[str, Array]) -> Array:
    """The covariance that follows from what a filter kept. Shape (steps, tracks, n, n)."""
    shape = next(iter(states.values())).shape
    memory = {
        kept.name: kept.whole(
            {place: states.get(kept.element(place), np.zeros(shape)) for place in kept.places()}
        )
        for kept in filter_.kept
    }
    with np.errstate(all="ignore"):
        elements = filter_.estimate(memory).P
    P = np.zeros((*shape, *elements.shape))
    for place in np.ndindex(*elements.shape):
        P[(..., *place)] = elements[place]
    return P


def where(valid: NDArray[np.bool_], estimates: Estimates) -> Estimates:
    """The estimates where ``valid`` (steps, tracks), NaN elsewhere."""

    def masked(array: Array) -> Array:
        mask = valid.reshape(valid.shape + (1,) * (array.ndim - valid.ndim))
        return np.where(mask, array, np.nan)

    return Estimates(
        x=masked(estimates.x),
        P=masked(estimates.P),
        innovation=masked(estimates.innovation),
        nis=masked(estimates.nis),
    )
