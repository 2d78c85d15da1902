"""From a model and an algorithm to the integers of one step."""

from dataclasses import dataclass

from kalmanhdl.algorithm.step import Update
from kalmanhdl.algorithm.trace import trace
from kalmanhdl.graph.balance import balanced
from kalmanhdl.graph.operations import Graph
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.numerics.quantise import quantise
from kalmanhdl.numerics.ranges import Plots, observed, simulated
from kalmanhdl.numerics.scaling import Scaling, scaled
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.numerics.units import units


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Numbers:
    """A step in numbers: the graph of reals in the hardware's units, and the same in integers."""

    scaling: Scaling
    graph: Graph
    typed: TypedGraph


def numbers(model: LinearModel, update: Update, specification: FixedSpecification) -> Numbers:
    """The integers of one step of an algorithm on a model. Formats rest on tracks drawn from the model."""
    plots = simulated(model, specification.coast)
    scaling = units(model, update, specification, plots)
    inner = scaled(model, scaling)
    graph = balanced(trace(inner, update))
    ranges = observed(graph, inner, in_units(plots, scaling))
    typed = quantise(graph, ranges, specification, scaling.units(model))
    return Numbers(scaling=scaling, graph=graph, typed=typed)


def in_units(plots: Plots, scaling: Scaling) -> Plots:
    """Plots in the units of a scaling."""
    return Plots(
        z=plots.z / scaling.measurement,
        u=plots.u / scaling.control,
        valid=plots.valid,
        relevant=plots.relevant,
    )
