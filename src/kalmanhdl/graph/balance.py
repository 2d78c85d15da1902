"""Sums rearranged: equal factors collected, what is known early added first.

Sums are exact, so their order is free; an unnamed sum has no format of its own in which order could show.
"""

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction

from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.operations import (
    Add,
    Constant,
    Divide,
    Graph,
    Multiply,
    Operation,
    Reciprocal,
    Select,
    Subtract,
    operands,
)
from kalmanhdl.graph.simplify import TERM, with_origins

# About how long an operation takes, in additions; only the order of sums rests on it.
_ADD, _MULTIPLY, _BY_CONSTANT, _DIVIDE = 1, 3, 2, 12


@dataclass(frozen=True, slots=True)
class _Term:
    """A signed addend, and when it is known."""

    sign: int
    index: int
    depth: int


def balanced(graph: Graph) -> Graph:
    """The same function with every sum of several terms as shallow as its operands allow."""
    builder, moved, depth = Builder(), dict[int, int](), dict[int, int]()
    inner = {k for k in range(len(graph.operations)) if _is_inner(graph, k)}
    for index, operation in enumerate(graph.operations):
        if index in inner:
            continue
        if isinstance(operation, Add | Subtract):
            terms = _terms(graph, index, 1)
            new, time = _summed(builder, [(sign, moved[k], depth[moved[k]]) for sign, k in terms], depth)
        else:
            new = builder.rebuild(operation, moved)
            time = max((depth[moved[k]] for k in operands(operation)), default=0) + _cost(graph, operation)
        moved[index] = new
        depth.setdefault(new, time)
        if graph.origins[index] and not isinstance(operation, Constant):
            builder.name(new, graph.origins[index])
    return with_origins(
        builder.graph(
            [(name, moved[index]) for name, index in graph.states],
            [(name, moved[index]) for name, index in graph.outputs],
        )
    )


def _is_inner(graph: Graph, index: int) -> bool:
    """A sum without a name that one sum alone uses."""
    users = graph.users[index]
    return (
        isinstance(graph.operations[index], Add | Subtract)
        and graph.origins[index].endswith(TERM)
        and len(users) == 1
        and isinstance(graph.operations[users[0]], Add | Subtract)
        and index not in graph.roots
    )


def _terms(graph: Graph, index: int, sign: int) -> list[tuple[int, int]]:
    operation = graph.operations[index]
    assert isinstance(operation, Add | Subtract)
    found = []
    for operand, factor in (
        (operation.a, sign),
        (operation.b, -sign if isinstance(operation, Subtract) else sign),
    ):
        if _is_inner(graph, operand):
            found += _terms(graph, operand, factor)
        else:
            found.append((factor, operand))
    return found


def _summed(builder: Builder, terms: list[tuple[int, int, int]], depth: dict[int, int]) -> tuple[int, int]:
    """The sum of signed terms, those with a common constant factor added before they are multiplied."""
    plain, groups = list[_Term](), defaultdict[Fraction, list[_Term]](list)
    for sign, index, time in terms:
        operation = builder.operations[index]
        factor = builder.value(operation.a) if isinstance(operation, Multiply) else None
        if factor is None or not isinstance(operation, Multiply):
            plain.append(_Term(sign, index, time))
        else:
            groups[factor].append(_Term(sign, operation.b, depth.get(operation.b, 0)))
    for factor, members in groups.items():
        total = _tree(builder, members)
        scaled = builder.multiply(builder.constant(factor), total.index)
        plain.append(_Term(total.sign, scaled, total.depth + _BY_CONSTANT))
    total = _tree(builder, plain)
    return (total.index if total.sign > 0 else builder.negate(total.index)), total.depth


def _tree(builder: Builder, terms: list[_Term]) -> _Term:
    """Terms added two by two, the two that are known first being next."""
    terms = sorted(terms, key=lambda term: term.depth)
    while len(terms) > 1:
        a, b, *terms = terms
        terms = sorted([*terms, _pair(builder, a, b)], key=lambda term: term.depth)
    return terms[0]


def _pair(builder: Builder, a: _Term, b: _Term) -> _Term:
    depth = max(a.depth, b.depth) + _ADD
    if a.sign == b.sign:
        return _Term(a.sign, builder.add(a.index, b.index), depth)
    positive, negative = (a, b) if a.sign > 0 else (b, a)
    return _Term(1, builder.subtract(positive.index, negative.index), depth)


def _cost(graph: Graph, operation: Operation) -> int:
    match operation:
        case Multiply(a):
            return _BY_CONSTANT if isinstance(graph.operations[a], Constant) else _MULTIPLY
        case Divide() | Reciprocal():
            return _DIVIDE
        case Select():
            return _ADD
        case _:
            return 0
