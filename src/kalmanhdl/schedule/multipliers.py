"""Which multiplications go to multiplier blocks, and which are built from logic."""

from collections.abc import Callable, Iterable

from kalmanhdl.graph.operations import Constant, Graph, Multiply, is_flag, operands
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.operators import is_multiplier, operators, shared_operator
from kalmanhdl.target.device import Device


def on_blocks(
    typed: TypedGraph | FloatGraph, device: Device, limit: int | None, outputs_in_logic: bool
) -> frozenset[int]:
    """The operations that multiply on blocks, at most ``limit`` blocks of them.

    Multiplications by a few bits never do. What no number of the state depends on leaves the blocks
    first (at once with ``outputs_in_logic``), then what lies on no loop of the states, then the least
    critical.
    """
    candidates = frozenset(k for k in range(len(typed.graph.operations)) if is_multiplier(typed, k))
    library = operators(typed, device, candidates)
    graph = typed.graph
    # A flag kept for the report, such as that of saturation, is no reason to hurry what it watches.
    numbers = (root for _, root in graph.states if not is_flag(graph.operations[root]))
    updates = _behind(numbers, graph)
    if outputs_in_logic:
        candidates &= updates
    used = sum(library[k].blocks for k in candidates)
    if limit is None or used <= limit:
        return candidates
    loops = _on_loops(graph)
    through = _longest_through(graph, [operator.delay for operator in library])
    kept = set(candidates)
    for index in sorted(candidates, key=lambda k: (k in updates, k in loops, through[k], -k)):
        if used <= limit:
            break
        kept.discard(index)
        used -= library[index].blocks
    return frozenset(kept)


def too_wide(
    typed: TypedGraph | FloatGraph, device: Device, on_block: frozenset[int], count: int
) -> frozenset[int]:
    """Products by constants that ``count`` shared multipliers of a block each are better spared.

    One operand wider than a block makes all multipliers larger on which its product takes turns. Such
    products, where they are no more than the multipliers, are sums of shifts instead; none of them where
    others are too wide as well.
    """
    graph = typed.graph
    products = [k for k in sorted(on_block) if isinstance(graph.operations[k], Multiply)]
    if isinstance(typed, FloatGraph) or len(products) <= count:
        return frozenset()

    def blocks(who: list[int]) -> int:
        return shared_operator(typed, "multiply", tuple(who), device, count, on_block).blocks

    wide = frozenset(k for k in products if blocks([k]) > 1)
    rest = [k for k in products if k not in wide]
    by_constants = all(
        any(isinstance(graph.operations[a], Constant) for a in operands(graph.operations[k])) for k in wide
    )
    spared = by_constants and len(wide) <= count and bool(rest) and blocks(rest) == 1
    return wide if spared else frozenset()


def _behind(roots: Iterable[int], graph: Graph) -> frozenset[int]:
    """Everything that the roots depend on within a step."""
    reached = set(roots)
    for index in reversed(range(len(graph.operations))):
        if index in reached:
            reached.update(operands(graph.operations[index]))
    return frozenset(reached)


def _on_loops(graph: Graph) -> frozenset[int]:
    """Operations that depend, over any number of steps, on themselves (Tarjan's components)."""
    names = {getattr(o, "name", None): k for k, o in enumerate(graph.operations) if not operands(o)}
    next_step: dict[int, list[int]] = {}
    for name, root in graph.states:
        if name in names:
            next_step.setdefault(root, []).append(names[name])
    users = graph.users

    def successors(index: int) -> list[int]:
        return [*users[index], *next_step.get(index, ())]

    return frozenset(
        k
        for component in _components(len(graph.operations), successors)
        if len(component) > 1
        for k in component
    )


def _components(count: int, successors: Callable[[int], list[int]]) -> list[list[int]]:
    """Strongly connected components, by two sweeps (Kosaraju), without recursion."""
    reverse: list[list[int]] = [[] for _ in range(count)]
    for index in range(count):
        for k in successors(index):
            reverse[k].append(index)
    order: list[int] = []
    seen: set[int] = set()
    for root in range(count):
        order += _post_order(root, successors, seen)
    seen.clear()
    return [_post_order(root, reverse.__getitem__, seen) for root in reversed(order) if root not in seen]


def _post_order(root: int, successors: Callable[[int], list[int]], seen: set[int]) -> list[int]:
    if root in seen:
        return []
    seen.add(root)
    order: list[int] = []
    stack = [(root, iter(successors(root)))]
    while stack:
        index, rest = stack[-1]
        following = next((k for k in rest if k not in seen), None)
        if following is None:
            order.append(index)
            stack.pop()
        else:
            seen.add(following)
            stack.append((following, iter(successors(following))))
    return order


def _longest_through(graph: Graph, delays: list[int]) -> list[int]:
    """The longest combinational path through every operation, in picoseconds."""
    reads = [operands(operation) for operation in graph.operations]
    until: list[int] = []
    for index, delay in enumerate(delays):
        until.append(delay + max((until[k] for k in reads[index]), default=0))
    after = [0] * len(delays)
    for index in reversed(range(len(delays))):
        for k in reads[index]:
            after[k] = max(after[k], after[index] + delays[index])
    return [a + b for a, b in zip(until, after, strict=True)]
