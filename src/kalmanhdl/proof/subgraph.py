"""What a filter computes without its measurements: the part of a typed graph that commands alone decide.

Of a linear filter that is the covariance and all that follows from it. Such a part is found by looking at the
graph, whatever the algorithm.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from kalmanhdl.graph.builder import reachable
from kalmanhdl.graph.operations import Graph, Input, Operation, State, StateFlag, is_flag, operands
from kalmanhdl.numerics.typed import TypedGraph


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """States that influence each other: those that commands alone decide, and the others.

    ``flags`` are the valid flags that any of them looks at.
    """

    decided: tuple[str, ...]
    others: tuple[str, ...]
    flags: tuple[str, ...]


def decided(typed: TypedGraph) -> frozenset[int]:
    """The operations, flags among them, whose values follow from the commands that a track was given."""
    operations = typed.graph.operations
    roots = dict(typed.graph.states)
    names = set(roots)
    while True:
        found = _closed(operations, names)
        lost = {name for name in names if roots[name] not in found}
        if not lost:
            return frozenset(found)
        names -= lost


def _closed(operations: Sequence[Operation], states: set[str]) -> set[int]:
    found: set[int] = set()
    for index, operation in enumerate(operations):
        match operation:
            case Input():
                continue
            case State(name) | StateFlag(name):
                if name not in states:
                    continue
            case _:
                if not all(a in found for a in operands(operation)):
                    continue
        found.add(index)
    return found


def parts(typed: TypedGraph, known: frozenset[int]) -> tuple[Part, ...]:
    """The states of a graph in groups that never influence each other; sticky flags are left out."""
    operations = typed.graph.operations
    roots = {name: root for name, root in typed.graph.states if not is_flag(operations[root])}
    cones = {name: reachable(operations, [root]) for name, root in roots.items()}
    groups: list[set[str]] = []
    for name, cone in cones.items():
        touched = {op.name for k in cone if isinstance(op := operations[k], State)} | {name}
        joined = [group for group in groups if group & touched]
        groups = [group for group in groups if not group & touched]
        groups.append(touched.union(*joined))
    order = list(roots)
    found = []
    for group in sorted(groups, key=lambda group: min(map(order.index, group))):
        names = sorted(group, key=order.index)
        seen = {getattr(operations[k], "name", "") for name in names for k in cones[name]}
        found.append(
            Part(
                decided=tuple(name for name in names if roots[name] in known),
                others=tuple(name for name in names if roots[name] not in known),
                flags=tuple(sorted(flag for flag in seen if flag.startswith("valid["))),
            )
        )
    return tuple(found)


def states_of(typed: TypedGraph, index: int) -> frozenset[str]:
    """The states that a value depends on in its step."""
    operations = typed.graph.operations
    seen = reachable(operations, [index])
    return frozenset(op.name for k in seen if isinstance(op := operations[k], State))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reduced:
    """A typed graph of some states, with further values as outputs, by their index in the whole graph.

    ``places`` says which operation of the whole graph each one of the reduced graph is.
    """

    typed: TypedGraph
    places: tuple[int, ...]


def reduced(typed: TypedGraph, states: Iterable[str], shown: Iterable[int]) -> Reduced:
    """The part of a graph that makes some states and shows some values; violations stay that concern it."""
    graph, kept_states, shown = typed.graph, set(states), list(shown)
    chosen = [(name, root) for name, root in graph.states if name in kept_states]
    cone = reachable(graph.operations, [*(root for _, root in chosen), *shown])
    watched = [v for v in typed.violations if v.quantise in cone]
    roots = [*(root for _, root in chosen), *shown, *(v.outside for v in watched)]
    places = sorted(reachable(graph.operations, roots))
    new = {old: place for place, old in enumerate(places)}
    part = Graph(
        operations=tuple(_moved(graph.operations[old], new) for old in places),
        origins=tuple(graph.origins[old] for old in places),
        states=tuple((name, new[root]) for name, root in chosen),
        outputs=tuple((str(old), new[old]) for old in sorted({*shown, *(v.outside for v in watched)})),
    )
    return Reduced(
        typed=replace(
            typed,
            graph=part,
            formats=tuple(typed.formats[old] for old in places),
            intervals=tuple(typed.intervals[old] for old in places),
            violations=tuple(replace(v, quantise=new[v.quantise], outside=new[v.outside]) for v in watched),
            scales={},
        ),
        places=tuple(places),
    )


def _moved(operation: Operation, new: dict[int, int]) -> Operation:
    changed: dict[str, Any] = {
        field.name: new[getattr(operation, field.name)]
        for field in fields(operation)
        if field.name in ("flag", "a", "b")
    }
    return replace(operation, **changed) if changed else operation
