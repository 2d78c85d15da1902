"""Running a filter on Signals to see its graph."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Filter, Given, Outcome, step
from kalmanhdl.algorithm.memory import COUNTER, Kind, Memory
from kalmanhdl.graph.builder import Builder, reachable
from kalmanhdl.graph.operations import Flag, Graph, Input, State, operands
from kalmanhdl.graph.signal import Signal, is_zero
from kalmanhdl.graph.simplify import simplified
from kalmanhdl.model.model import Model

Pattern = dict[str, NDArray[np.bool_]]


def trace(model: Model, filter_: Filter) -> Graph:
    """The graph of one step, simplified, with the zeros of the memory that no step fills left out.

    States are what the filter keeps, such as ``x[i]`` and the upper triangle ``P[i,j]``; outputs
    ``x[i]``, ``P[i,i]``, ``innovation[j]`` and ``nis``; flags ``initialise`` and ``valid[j]``; inputs
    ``z[j]`` and ``u[k]``.
    """
    pattern = started(model, filter_)
    while True:
        graph, filled = _traced(model, filter_, pattern)
        if all(np.array_equal(filled[name], pattern[name]) for name in pattern):
            return graph
        pattern = filled


def started(model: Model, filter_: Filter, builder: Builder | None = None) -> Pattern:
    """The elements that are not zero in a memory that has just started; every mean may be any number."""
    builder = builder or Builder()
    everything = {kept.name: np.ones(kept.shape, bool) for kept in filter_.kept}
    memory = filter_.start(_states(builder, filter_, everything), _inputs(builder, model))
    means = {kept.name for kept in filter_.kept if kept.kind is Kind.STATE}
    return {name: _filled(array) | (name in means) for name, array in memory.items()}


def _filled(array: NDArray[Any]) -> NDArray[np.bool_]:
    result = np.zeros(array.shape, bool)
    for place in np.ndindex(*array.shape):
        result[place] = not is_zero(array[place])
    return result


def _traced(model: Model, filter_: Filter, pattern: Pattern) -> tuple[Graph, Pattern]:
    """The graph when the memory has a pattern of elements, and that pattern with those a step fills."""
    graph, filled = on_builder(Builder(), model, filter_, pattern)
    return simplified(graph), filled


def on_builder(builder: Builder, model: Model, filter_: Filter, pattern: Pattern) -> tuple[Graph, Pattern]:
    """The graph as a builder collects it, not yet simplified, and the pattern with what a step fills."""
    memory = _states(builder, filter_, pattern)
    outcome = step(filter_, memory, _inputs(builder, model))
    filled = {name: pattern[name] | _filled(array) for name, array in outcome.memory.items()}
    states, outputs = _results(builder, filter_, outcome, pattern)
    live = _live(builder, states, outputs)
    return builder.graph([s for s in states if s[0] in live], outputs), filled


def _states(builder: Builder, filter_: Filter, pattern: Pattern) -> Memory:
    return {
        kept.name: kept.whole(
            {
                place: _leaf(builder, State(kept.element(place)))
                for place in kept.places()
                if pattern[kept.name][place]
            }
        )
        for kept in filter_.kept
    }


def _inputs(builder: Builder, model: Model) -> Given:
    return Given(
        z=np.array([_leaf(builder, Input(f"z[{j}]")) for j in range(model.m)], object),
        valid=tuple(_leaf(builder, Flag(f"valid[{j}]")) for j in range(model.m)),
        u=np.array([_leaf(builder, Input(f"u[{k}]")) for k in range(model.p)], object),
        initialise=_leaf(builder, Flag("initialise")),
    )


def _leaf(builder: Builder, operation: Input | State | Flag) -> Signal:
    index = builder.intern(operation)
    builder.name(index, operation.name)
    return Signal(builder, index)


Named = list[tuple[str, int]]


def _results(builder: Builder, filter_: Filter, outcome: Outcome, pattern: Pattern) -> tuple[Named, Named]:
    def index(value: object) -> int:
        return value.index if isinstance(value, Signal) else builder.number(float(value))  # type: ignore[arg-type]

    states = [
        (each.element(place), index(outcome.memory[each.name][place]))
        for each in filter_.kept
        for place in each.places()
        if pattern[each.name][place]
    ]
    nis = index(outcome.nis)
    builder.name(nis, "output: nis")
    x, P = outcome.belief.x, outcome.belief.P
    outputs = [(f"x[{i}]", index(value)) for i, value in enumerate(x)]
    outputs += [(f"P[{i},{i}]", index(P[i, i])) for i in range(len(x))]
    outputs += [(f"innovation[{j}]", index(y)) for j, y in enumerate(outcome.innovation)]
    outputs += [
        (each.element(place), index(outcome.memory[each.name][place]))
        for each in filter_.kept
        if each.name in filter_.shown
        for place in each.places()
    ]
    return states, [*outputs, ("nis", nis)]


def _live(builder: Builder, states: Named, outputs: Named) -> set[str]:
    """The states that an output needs, now or in a later step."""
    roots, live = dict(states), set[str]()
    waiting = [index for _, index in outputs]
    while waiting:
        seen = reachable(builder.operations, waiting)
        read = {op.name for k in seen if isinstance(op := builder.operations[k], State)} - live
        live |= read
        waiting = [roots[name] for name in sorted(read)]
    return live


def components(graph: Graph) -> tuple[tuple[str, ...], ...]:
    """The decoupled parts of a filter: groups of outputs ``x[i]`` that never influence each other."""
    groups: list[set[str]] = []
    means = [(_MEAN + name, index) for name, index in graph.outputs if name.startswith("x[")]
    names, read = _states_read(graph)
    for name, root in (*graph.states, *means):
        touched = {name} | {each for k, each in enumerate(names) if read[root] >> k & 1}
        touched = {name for name in touched if not name.startswith(f"{COUNTER}[")}
        joined = [group for group in groups if group & touched]
        groups = [group for group in groups if not group & touched]
        groups.append(touched.union(*joined))
    found = [
        sorted((s.removeprefix(_MEAN) for s in group if s.startswith(_MEAN)), key=_number) for group in groups
    ]
    return tuple(sorted((tuple(group) for group in found if group), key=lambda group: _number(group[0])))


def _states_read(graph: Graph) -> tuple[list[str], list[int]]:
    """The states that are read, and for each operation a bit for each of them that it depends on."""
    names = [op.name for op in graph.operations if isinstance(op, State)]
    place = {name: 1 << k for k, name in enumerate(names)}
    read: list[int] = []
    for operation in graph.operations:
        own = place[operation.name] if isinstance(operation, State) else 0
        for k in operands(operation):
            own |= read[k]
        read.append(own)
    return names, read


# Tells an output from a state of the same name.
_MEAN = "output "


def _number(name: str) -> int:
    return int(name[2:-1])
