"""The order of a section's instructions: what others wait for longest comes first, as soon as it can.

An accumulating instruction takes the place of what it accumulates to, which must not be needed any more.
"""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from kalmanhdl.processor.compiler.graph import (
    Computed,
    Constant,
    Given,
    Held,
    Node,
    Put,
    Read,
    Section,
    sources_of,
)
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import ACCUMULATING, Opcode
from kalmanhdl.processor.timing import JUMP_CLOCKS, latency, passes

_TRIES = 100
_EFFORT = 400_000
_SHAKE = 6.0
"""Orders that are tried, fewer of long sections, and by how many clocks urgencies are shaken for them."""


def scheduled(section: Section, core: Core, outputs: Sequence[tuple[Held | Constant, int]]) -> Section:
    """The live nodes of a section in the order of the program, with the copies that it needs.

    ``outputs`` are elements of constants, and of the held matrices as the section before left them. They are
    put out before anything is read, which may take its time to come.
    """
    copied = _with_copies(_putting_out(section, outputs))
    return _permuted(copied, _order(copied, core))


def _putting_out(section: Section, outputs: Sequence[tuple[Held | Constant, int]]) -> Section:
    nodes = list(section.nodes)
    for of in dict.fromkeys(of for of, _ in outputs):
        if of not in nodes:
            nodes.append(of)
    nodes += [Put(nodes.index(of), element) for of, element in outputs]
    return replace(section, nodes=tuple(nodes))


def accumulated_into(section: Section) -> dict[int, int]:
    """For every node the last one that is accumulated in its place: itself where there is none."""
    ends = {index: index for index in range(len(section.nodes))}
    for index in range(len(section.nodes) - 1, -1, -1):
        node = section.nodes[index]
        if isinstance(node, Computed) and node.in_place:
            ends[node.sources[-1]] = ends[index]
    return ends


def _with_copies(section: Section) -> Section:
    """The live nodes, what must stay copied before something is accumulated to it."""
    live = section.live
    users = _users(section, live)
    numbers: dict[int, int] = {}
    nodes: list[Node] = []
    comments: dict[int, str] = {}
    for index in live:
        node = section.nodes[index]
        moved = _renumbered(node, numbers)
        if isinstance(node, Computed) and isinstance(moved, Computed) and node.in_place:
            base = node.sources[-1]
            if _stays(section, base, index, users):
                nodes.append(Computed(Opcode.COPY, (numbers[base],)))
                moved = replace(moved, sources=(*moved.sources[:-1], len(nodes) - 1))
        numbers[index] = len(nodes)
        if index in section.comments:
            comments[len(nodes)] = section.comments[index]
        nodes.append(moved)
    held = {name: numbers[node] for name, node in section.held.items()}
    return Section(name=section.name, nodes=tuple(nodes), comments=comments, held=held)


def _users(section: Section, live: Sequence[int]) -> dict[int, list[int]]:
    users: dict[int, list[int]] = {index: [] for index in live}
    for index in live:
        for source in set(sources_of(section.nodes[index])):
            users[source].append(index)
    return users


def _stays(section: Section, base: int, by: int, users: Mapping[int, Sequence[int]]) -> bool:
    """Whether what a node accumulates to is still needed as it is, by something that comes later."""
    node = section.nodes[base]
    own = isinstance(node, Held) and section.held.get(node.name) == by
    if isinstance(node, Constant) or (isinstance(node, Held) and not own) or base in section.held.values():
        return True
    assert isinstance(section.nodes[by], Computed)
    factors = sources_of(section.nodes[by])[:-1]
    return base in factors or any(user > by for user in users[base])


def _renumbered(node: Node, numbers: Mapping[int, int]) -> Node:
    match node:
        case Constant() | Held() | Read():
            return node
        case Given():
            return replace(node, reads=tuple(numbers[read] for read in node.reads))
        case Computed():
            return replace(node, sources=tuple(numbers[source] for source in node.sources))
        case Put():
            return replace(node, source=numbers[node.source])


@dataclass(frozen=True, slots=True)
class _Cost:
    """Clocks in which nothing else issues, of the array, until the result is there; if it is stored."""

    issue: int
    array: int
    result: int
    stores: bool = True


def _cost(node: Node, core: Core) -> _Cost:
    match node:
        case Constant() | Held() | Given():
            return _Cost(0, 0, 0, stores=False)
        case Computed(opcode, _):
            if not core.pipelined:
                return _Cost(1, 0, 1)
            return _Cost(1, passes(opcode, core), latency(opcode, core))
        case Read():
            return _Cost(1, 0, 1)
        case Put():
            return _Cost(1, 0, 1, stores=False)


def _waits(section: Section) -> list[dict[int, bool]]:
    """For every node those before which it cannot issue; whether it needs what they compute."""
    waits: list[dict[int, bool]] = [{} for _ in section.nodes]
    exchanged: list[int] = []
    for index, node in enumerate(section.nodes):
        waits[index] = dict.fromkeys(sources_of(node), True)
        if isinstance(node, Computed) and node.in_place and node.opcode not in ACCUMULATING:
            # It leaves the other elements alone, and reads none of them.
            waits[index][node.sources[-1]] = False
    for kind in (Put, Read):
        of_kind = [index for index, node in enumerate(section.nodes) if isinstance(node, kind)]
        exchanged += of_kind
    for before, after in pairwise(exchanged):
        waits[after].setdefault(before, False)
    users = _users(section, range(len(section.nodes)))
    for index, node in enumerate(section.nodes):
        if isinstance(node, Computed) and node.in_place:
            for user in users[node.sources[-1]]:
                if user != index:
                    waits[index].setdefault(user, False)
    _after_old_values(section, waits, users)
    return waits


def _after_old_values(
    section: Section, waits: list[dict[int, bool]], users: Mapping[int, Sequence[int]]
) -> None:
    """What becomes a held matrix waits for the users of the old one, so that it can be made in its place."""
    ends = accumulated_into(section)
    for name, result in section.held.items():
        root = min(index for index, end in ends.items() if end == result)
        for index, node in enumerate(section.nodes):
            if node == Held(name):
                for user in users[index]:
                    if user != root and not _reaches(waits, root, user):
                        waits[root].setdefault(user, False)


def _reaches(waits: Sequence[Mapping[int, bool]], first: int, later: int) -> bool:
    """Whether a node waits, by whatever way, for another one."""
    seen, left = {later}, [later]
    while left:
        for each in waits[left.pop()]:
            if each == first:
                return True
            if each not in seen:
                seen.add(each)
                left.append(each)
    return False


def _order(section: Section, core: Core) -> list[int]:
    """The shortest of several greedy orders, on the core's own time."""
    waits = _waits(section)
    costs = [_cost(node, core) for node in section.nodes]
    urgency = _urgency(section, waits, costs, core)
    best, shortest = _greedy(section, waits, costs, urgency)
    rng = random.Random(0)
    for _ in range(min(_TRIES, _EFFORT // len(costs) ** 2) if core.pipelined else 0):
        shaken = [each + rng.uniform(0, _SHAKE) for each in urgency]
        order, length = _greedy(section, waits, costs, shaken)
        if length < shortest:
            best, shortest = order, length
    return best


def _greedy(
    section: Section,
    waits: Sequence[Mapping[int, bool]],
    costs: Sequence[_Cost],
    urgency: Sequence[float],
) -> tuple[list[int], int]:
    """What can issue soonest is next, the most urgent of these; and the clocks until the next pass."""
    order: list[int] = []
    issued: dict[int, int] = {}
    stored: set[int] = set()
    clock, array_free = 0, 0
    left = set(range(len(costs)))
    while left:
        ready = {}
        for index in left:
            if all(each in issued for each in waits[index]):
                # An order alone is kept by issuing later.
                times = [
                    issued[each] + (costs[each].result if needs else min(1, costs[each].issue))
                    for each, needs in waits[index].items()
                ]
                time = max([*times, array_free if costs[index].array else 0, clock])
                while costs[index].stores and time + costs[index].result in stored:
                    time += 1
                ready[index] = time
        soonest = min(ready.values())
        chosen = min((k for k in ready if ready[k] == soonest), key=lambda k: (-urgency[k], k))
        issued[chosen] = soonest
        clock = soonest + costs[chosen].issue
        if costs[chosen].stores:
            stored.add(soonest + costs[chosen].result)
        if costs[chosen].array:
            array_free = soonest + costs[chosen].array
        order.append(chosen)
        left.remove(chosen)
    held = [issued[node] + costs[node].result for node in section.held.values()]
    return order, max([clock + JUMP_CLOCKS, *held])


def _urgency(
    section: Section, waits: Sequence[Mapping[int, bool]], costs: Sequence[_Cost], core: Core
) -> list[int]:
    """Clocks from a node to the end of the section, at least; as traced where nothing overlaps."""
    count = len(section.nodes)
    if not core.pipelined:
        return [count - index for index in range(count)]
    urgency = [cost.result for cost in costs]
    changed = True
    while changed:
        changed = False
        for index in range(count):
            for each, needs in waits[index].items():
                least = urgency[index] + (costs[each].result if needs else min(1, costs[each].issue))
                if least > urgency[each]:
                    urgency[each], changed = least, True
    return urgency


def _permuted(section: Section, order: Sequence[int]) -> Section:
    numbers = {old: new for new, old in enumerate(order)}
    return Section(
        name=section.name,
        nodes=tuple(_renumbered(section.nodes[old], numbers) for old in order),
        comments={numbers[old]: text for old, text in section.comments.items()},
        held={name: numbers[old] for name, old in section.held.items()},
    )
