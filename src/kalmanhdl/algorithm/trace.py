"""Running an algorithm on Signals to see its graph."""

import numpy as np

from kalmanhdl.algorithm.step import Belief, Given, Outcome, Update, step
from kalmanhdl.graph.builder import Builder, reachable
from kalmanhdl.graph.operations import Flag, Graph, Input, State
from kalmanhdl.graph.signal import Array, Signal, is_zero
from kalmanhdl.graph.simplify import simplified
from kalmanhdl.model.state_space import LinearModel


def trace(model: LinearModel, update: Update) -> Graph:
    """The graph of one step, simplified, with the zeros of P that no step fills left out.

    States are ``x[i]`` and the upper triangle ``P[i,j]``; outputs ``x[i]``, ``P[i,i]``,
    ``innovation[j]`` and ``nis``; flags ``initialise`` and ``valid[j]``; inputs ``z[j]`` and ``u[k]``.
    """
    pattern = model.initial.P != 0
    while True:
        graph, filled = _traced(model, update, pattern)
        if np.array_equal(filled, pattern):
            return graph
        pattern = filled


def _traced(model: LinearModel, update: Update, pattern: Array) -> tuple[Graph, Array]:
    """The graph when P starts with a pattern of entries, and that pattern with those a step fills."""
    builder = Builder()
    belief = _states(builder, pattern)
    outcome = step(model, update, belief, _inputs(builder, model))
    filled = pattern | np.array([[not is_zero(p) for p in row] for row in outcome.belief.P])
    states, outputs = _results(builder, outcome, pattern)
    live = _live(builder, states, outputs)
    return simplified(builder.graph([s for s in states if s[0] in live], outputs)), filled


def _states(builder: Builder, pattern: Array) -> Belief:
    n = len(pattern)
    x = np.array([_leaf(builder, State(f"x[{i}]")) for i in range(n)], object)
    P = np.zeros((n, n), object)
    for i, j in zip(*np.triu_indices(n), strict=True):
        if pattern[i, j]:
            P[i, j] = P[j, i] = _leaf(builder, State(f"P[{i},{j}]"))
    return Belief(x, P)


def _inputs(builder: Builder, model: LinearModel) -> Given:
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


def _results(builder: Builder, outcome: Outcome, pattern: Array) -> tuple[Named, Named]:
    n = len(pattern)

    def index(value: object) -> int:
        return value.index if isinstance(value, Signal) else builder.constant(float(value))  # type: ignore[arg-type]

    x, P = outcome.belief.x, outcome.belief.P
    states = [(f"x[{i}]", index(x[i])) for i in range(n)]
    states += [(f"P[{i},{j}]", index(P[i, j])) for i in range(n) for j in range(i, n) if pattern[i, j]]
    nis = index(outcome.nis)
    builder.name(nis, "output: nis")
    outputs = [(f"x[{i}]", index(x[i])) for i in range(n)]
    outputs += [(f"P[{i},{i}]", index(P[i, i])) for i in range(n)]
    outputs += [(f"innovation[{j}]", index(y)) for j, y in enumerate(outcome.innovation)]
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
    """The decoupled parts of a filter: groups of states ``x[i]`` that never influence each other."""
    groups: list[set[str]] = []
    for name, root in graph.states:
        seen = reachable(graph.operations, [root])
        touched = {op.name for k in seen if isinstance(op := graph.operations[k], State)} | {name}
        joined = [group for group in groups if group & touched]
        groups = [group for group in groups if not group & touched]
        groups.append(touched.union(*joined))
    means = [tuple(sorted((s for s in group if s.startswith("x[")), key=_number)) for group in groups]
    return tuple(sorted((group for group in means if group), key=lambda group: _number(group[0])))


def _number(name: str) -> int:
    return int(name[2:-1])
