"""Graph to graph: what can only be seen when the whole graph is there."""

from collections import Counter

from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.operations import (
    Binary,
    Constant,
    Divide,
    Function,
    Graph,
    Operation,
    Reciprocal,
    Unary,
    operands,
)


def simplified(graph: Graph) -> Graph:
    """The same function with fewer operations, every operation named by its own or its user's origin."""
    return with_origins(rebuilt(graph, shared_divisors(graph)))


def shared_divisors(graph: Graph) -> frozenset[int]:
    """The divisors for which one reciprocal replaces several divisions."""
    uses = Counter(op.b for op in graph.operations if isinstance(op, Divide))
    uses.update(op.a for op in graph.operations if isinstance(op, Reciprocal))
    return frozenset(divisor for divisor, count in uses.items() if count > 1)


def rebuilt(graph: Graph, shared: frozenset[int]) -> Graph:
    """The graph built anew, divisions by shared divisors being multiplications by the reciprocal."""
    builder, moved = Builder(), dict[int, int]()
    for index, operation in enumerate(graph.operations):
        if isinstance(operation, Divide) and operation.b in shared:
            reciprocal = builder.reciprocal(moved[operation.b])
            moved[index] = builder.multiply(moved[operation.a], reciprocal)
        else:
            moved[index] = builder.rebuild(operation, moved)
        if graph.origins[index]:
            builder.name(moved[index], graph.origins[index])
    return builder.graph(
        [(name, moved[index]) for name, index in graph.states],
        [(name, moved[index]) for name, index in graph.outputs],
    )


def with_origins(graph: Graph) -> Graph:
    """Every unnamed operation is a term of the first named one that uses it."""
    origins = list(graph.origins)
    for index in range(len(origins) - 1, -1, -1):
        if not origins[index] and not isinstance(graph.operations[index], Constant):
            users = [origins[user] for user in graph.users[index] if origins[user]]
            base = users[0] if users else "step"
            origins[index] = base if base.endswith(TERM) else base + TERM
    return Graph(graph.operations, tuple(origins), graph.states, graph.outputs)


TERM = " term"


def counts(operations: tuple[Operation, ...], needed: set[int]) -> dict[str, int]:
    """How many operations of each kind there are among those needed; of functions, those that there are."""
    found = Counter(_kind(operations, index) for index in needed)
    kinds = ("add", "subtract", "multiply", "constant_multiply", "divide", "reciprocal", "square_root")
    functions = (function.value for function in Function if found[function.value])
    return {kind: found[kind] for kind in (*kinds, *functions)}


def _kind(operations: tuple[Operation, ...], index: int) -> str:
    operation = operations[index]
    if isinstance(operation, Unary | Binary):
        return operation.function.value
    name = type(operation).__name__.lower()
    by_constant = any(isinstance(operations[i], Constant) for i in operands(operation))
    return "constant_multiply" if name == "multiply" and by_constant else name
