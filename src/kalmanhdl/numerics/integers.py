"""From a model and an algorithm to the integers of one step."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Algorithm, Filter
from kalmanhdl.algorithm.loadable import Traced, UnlikeError, trace_loadable, values
from kalmanhdl.algorithm.trace import trace
from kalmanhdl.graph.balance import balanced
from kalmanhdl.graph.operations import Graph
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.numerics.quantise import quantise
from kalmanhdl.numerics.ranges import Plots, Ranges, observed, of_all_ages
from kalmanhdl.numerics.scaling import Scaling
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.numerics.units import units
from kalmanhdl.validation import InvalidModelValueError, InvalidValueError, KalmanhdlWarning


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Numbers:
    """A step in numbers: the graph of reals in the hardware's units, and the same in integers."""

    scaling: Scaling
    graph: Graph
    typed: TypedGraph
    # What the numbers of the model were found to be, where they are loadable.
    traced: Traced | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reals:
    """What formats are chosen from: a step on reals in hardware units, and how large its values become."""

    model: Model
    scaling: Scaling
    graph: Graph
    ranges: Ranges
    scales: dict[str, float]
    traced: Traced | None = None


def numbers(
    model: Model,
    algorithm: Algorithm,
    specification: FixedSpecification,
    *,
    on_multipliers: bool = False,
    loadable: bool = False,
) -> Numbers:
    """The integers of one step of an algorithm on a model. Formats rest on tracks drawn from the model.

    Constants multiply by shifts and adds, or ``on_multipliers``. Sums of shifted values have wider bounds
    than products, so that an operand may be rounded before the one and not before the other. Numbers of a
    ``loadable`` model are coefficients: raises DesignError for models and algorithms that have others.
    """
    reals = in_reals(model, algorithm, specification, loadable=loadable)
    typed = quantise(reals.graph, reals.ranges, specification, reals.scales, on_multipliers=on_multipliers)
    return Numbers(scaling=reals.scaling, graph=reals.graph, typed=typed, traced=reals.traced)


def in_reals(
    model: Model, algorithm: Algorithm, specification: FixedSpecification, *, loadable: bool = False
) -> Reals:
    """One step of an algorithm on a model, observed over tracks drawn from the model."""
    plots = of_all_ages(model, specification.coast)
    if not np.isfinite(plots.z).all():
        problem = ": the model's tracks leave the numbers of double precision"
        raise InvalidModelValueError("model", "measurement_range", problem)
    trouble = algorithm.trouble(model, specification.coast)
    if trouble:
        warnings.warn(trouble, KalmanhdlWarning, stacklevel=2)
    scaling = units(model, algorithm(model), specification, plots)
    try:
        inner = model.in_units(scaling)
    except InvalidModelValueError as error:
        raise _beyond_units(specification, error.key, error.problem) from None
    for name, array in _arrays(inner):
        if not np.isfinite(array).all():
            raise _beyond_units(specification, name, " is no finite number")
    filter_ = algorithm.in_units(model, scaling.covariances())(inner)
    traced = _loadable(model, algorithm, scaling) if loadable else None
    graph = balanced(traced.graph if traced else trace(inner, filter_))
    scales = scaling.units(filter_.kept) | dict.fromkeys(values(graph), 1.0)
    ranges = observed(graph, inner, in_units(plots, scaling))
    return Reals(model=inner, scaling=scaling, graph=graph, ranges=ranges, scales=scales, traced=traced)


def filter_in_units(model: LinearModel, algorithm: Algorithm, scaling: Scaling) -> Filter:
    """The filter of a model in the units of a scaling."""
    with warnings.catch_warnings():
        # The user was warned of the model itself.
        warnings.simplefilter("ignore")
        return algorithm.in_units(model, scaling.covariances())(model.in_units(scaling))


def _loadable(model: Model, algorithm: Algorithm, scaling: Scaling) -> Traced:
    if not isinstance(model, LinearModel):
        problem = f' = "loadable": a {model.kind} model has formulas for numbers: use "fixed"'
        raise InvalidValueError("architecture", "coefficients", problem)
    try:
        return trace_loadable(model, lambda each: filter_in_units(each, algorithm, scaling))
    except UnlikeError:
        problem = f' = "loadable": "{algorithm.kind}" keeps numbers of the model in tables: use "fixed"'
        raise InvalidValueError("architecture", "coefficients", problem) from None


def _arrays(model: Model) -> Iterator[tuple[str, NDArray[np.float64]]]:
    for field in fields(model):
        value = getattr(model, field.name)
        if isinstance(value, np.ndarray):
            yield field.name, value


def _beyond_units(specification: FixedSpecification, key: str, problem: str) -> InvalidValueError:
    """A number of the model cannot be in the hardware's units: blamed on whoever chose these."""
    found = key + problem.partition(": ")[0]
    for scale in ("scale", "covariance_scale"):
        if getattr(specification, scale) != "auto":
            return InvalidValueError("numerics", scale, f": in these units {found}")
    cause = "in units that suit the values of the states, as they are chosen here,"
    remedy = "bring the model's numbers closer together, or give the units, [numerics] scale"
    return InvalidModelValueError("model", key, f": {cause} {found}: {remedy}")


def in_units(plots: Plots, scaling: Scaling) -> Plots:
    """Plots in the units of a scaling."""
    return Plots(
        z=plots.z / scaling.measurement,
        u=plots.u / scaling.control,
        valid=plots.valid,
        relevant=plots.relevant,
    )
