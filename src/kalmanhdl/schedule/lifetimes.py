"""Registers between operators: what a plan holds over from cycle to cycle, and how to hold less.

A value is held from the cycle in which it is there to the last cycle in which it is read; outputs are
held until the last of them is there, since they leave together. States are stored in the context at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from kalmanhdl.graph.operations import (
    Coefficient,
    Constant,
    Flag,
    Graph,
    Input,
    State,
    StateFlag,
    lags,
    operands,
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.placement import CYCLE_BITS, OFFSET_MASK, Pace


def widths(typed: TypedGraph | FloatGraph) -> list[int]:
    """Bits that a register for each value takes: none for what stands, both factors' for fused products."""
    pairs = typed.fused if isinstance(typed, FloatGraph) else frozenset[int]()
    return [
        0
        if isinstance(operation, Constant | Coefficient)
        else form.width * (1 + (index in pairs))
        if form
        else 1
        for index, (operation, form) in enumerate(zip(typed.graph.operations, typed.formats, strict=True))
    ]


def held_bits(
    typed: TypedGraph | FloatGraph, starts: Sequence[int], ends: Sequence[int], stand: int = 1
) -> int:
    """Register bits between operators of a step, when each register stands for so many cycles."""
    last = last_reads(typed.graph, starts, ends)
    return sum(
        width * -(-max(0, read - end) // stand)
        for width, read, end in zip(widths(typed), last, ends, strict=True)
    )


def result_cycle(graph: Graph, ends: Sequence[int]) -> int:
    """The cycle in which all outputs are there, and leave."""
    return max((ends[root] for _, root in graph.outputs), default=0)


def last_reads(graph: Graph, starts: Sequence[int], ends: Sequence[int]) -> list[int]:
    """The last cycle in which each value is read; its own where nothing reads it."""
    last = list(ends)
    for index, operation in enumerate(graph.operations):
        for k, lag in zip(operands(operation), lags(operation), strict=True):
            last[k] = max(last[k], starts[index] + lag)
    leave = result_cycle(graph, ends)
    for _, root in graph.outputs:
        last[root] = leave
    return last


def with_fewer_registers(
    typed: TypedGraph | FloatGraph, pace: Pace, starts: list[int], times: list[int], distance: int
) -> list[int]:
    """Start cycles that hold fewer bits, with the same last cycle and the same period.

    One sweep from the last operation to the first moves each as late as it pays: a state is read when
    it is needed, an operation whose operands are narrower than its value waits.
    """
    sweep = _Sweep.over(typed, pace, starts, times)
    graph = typed.graph
    sources = {o.name: k for k, o in enumerate(graph.operations) if isinstance(o, State | StateFlag)}
    for name, root in graph.states:
        if name in sources:
            # The new value must be there before the next step reads it at the earliest.
            sweep.end_by(root, starts[sources[name]] + distance - 1 - pace.step.context_overhead)
    for index in reversed(range(len(graph.operations))):
        if not isinstance(graph.operations[index], State | StateFlag | Constant | Input | Flag):
            sweep.settle(index)
    for name, root in graph.states:
        if name in sources:
            # Read no later than this step's own new value is stored.
            sweep.end_by(sources[name], sweep.ends[root])
            sweep.settle(sources[name])
    before = held_bits(typed, starts, [time >> CYCLE_BITS for time in times])
    return sweep.starts if held_bits(typed, sweep.starts, sweep.ends) < before else starts


@dataclass(slots=True, kw_only=True)
class _Sweep:
    """A schedule on its way to a later one.

    Operation k may end at the time ``latest[k]``, counted like the times of ``placement``, at any time
    within its bounds of an earlier cycle. ``needed[k]`` is the cycle until which outputs are held.
    """

    pace: Pace
    users: tuple[tuple[int, ...], ...]
    widths: list[int]
    wait: list[int]
    needed: list[int]
    starts: list[int]
    ends: list[int]
    latest: list[int]

    @classmethod
    def over(
        cls, typed: TypedGraph | FloatGraph, pace: Pace, starts: list[int], times: list[int]
    ) -> "_Sweep":
        """The schedule to begin with."""
        graph, bits = typed.graph, widths(typed)
        ends = [time >> CYCLE_BITS for time in times]
        leave, stored = result_cycle(graph, ends), max((ends[root] for root in graph.roots), default=0)
        sweep = cls(
            pace=pace,
            users=graph.users,
            widths=bits,
            wait=_waiting_costs(graph, bits),
            needed=list(ends),
            starts=list(starts),
            ends=ends,
            latest=[(stored << CYCLE_BITS) + pace.budget - tail for tail in pace.step.tails],
        )
        for _, root in graph.outputs:
            sweep.needed[root] = leave
            sweep.end_by(root, leave)
        return sweep

    def end_by(self, index: int, cycle: int) -> None:
        """Bound the cycle in which an operation ends."""
        self.latest[index] = min(self.latest[index], (cycle << CYCLE_BITS) + self._full(index))

    def settle(self, index: int) -> None:
        """Choose the end of an operation whose users stand, and bound its operands."""
        best, least = self.ends[index], self._held(index, self.ends[index])
        for end in range(best + 1, (self.latest[index] >> CYCLE_BITS) + 1):
            held = self._held(index, end)
            if held <= least and self.pace.lasts[index] <= self._room(index, end):
                best, least = end, held
        registers = self.pace.registers[index]
        room = 0 if registers else self._room(index, best) - self.pace.lasts[index]
        self.ends[index], self.starts[index] = best, best - registers
        ready = ((best - registers) << CYCLE_BITS) + room
        for k in self.pace.step.operands[index]:
            self.latest[k] = min(self.latest[k], ready)
            self.end_by(k, best - registers)

    def _full(self, index: int) -> int:
        return self.pace.budget - self.pace.step.tails[index]

    def _room(self, index: int, end: int) -> int:
        """The latest offset in a cycle at which the value may be there."""
        cycle, offset = self.latest[index] >> CYCLE_BITS, self.latest[index] & OFFSET_MASK
        return min(offset, self._full(index)) if end == cycle else self._full(index)

    def _held(self, index: int, end: int) -> int:
        """Bits held behind an operation that ends so, and before it because it does."""
        start = end - self.pace.registers[index]
        last = max((self.starts[user] for user in self.users[index]), default=end)
        held = self.widths[index] * (max(last, self.needed[index], end) - end)
        for k in self.pace.step.operands[index]:
            others = max((self.starts[u] for u in self.users[k] if u != index), default=self.ends[k])
            held += self.wait[k] * max(0, start - max(others, self.needed[k]))
        return held


def _waiting_costs(graph: Graph, bits: list[int]) -> list[int]:
    """Bits held longer when a value is needed a cycle later: its own, or its operands' if they can wait."""
    costs: list[int] = []
    for index, operation in enumerate(graph.operations):
        match operation:
            case State() | StateFlag():
                costs.append(0)
            case Input() | Flag() | Constant():
                costs.append(bits[index])
            case _:
                reads = dict.fromkeys(operands(operation))
                alone = sum(costs[k] if len(graph.users[k]) == 1 else bits[k] for k in reads)
                costs.append(min(bits[index], alone))
    return costs
