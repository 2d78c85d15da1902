"""As soon as possible: the earliest time of every operation at one clock period.

A time is ``cycle << CYCLE_BITS | picoseconds`` into the cycle, after the registers at its beginning.
Placing an operation is monotone in the times of its operands and commutes with a shift by whole
cycles, so that the latest of several paths decides and paths can be followed one by one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from kalmanhdl.graph.operations import Constant, Graph, State, StateFlag, SumOfProducts, lags, operands
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.operator import Operator, picoseconds
from kalmanhdl.schedule.operators import operators
from kalmanhdl.schedule.sharing import NONE_SHARED, Sharing
from kalmanhdl.target.device import Device

CYCLE_BITS = 40
OFFSET_MASK = (1 << CYCLE_BITS) - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step of a filter as operators: what does not change with the clock period.

    ``tails[k]`` is what must still follow operation k within its last cycle: the write to the context.
    ``lags[k]`` says for each operand how many cycles after its start the operation takes it, where it does
    not take all at once.
    """

    graph: Graph
    operators: tuple[Operator, ...]
    operands: tuple[tuple[int, ...], ...]
    tails: tuple[int, ...]
    register: int
    context_overhead: int
    lags: Mapping[int, tuple[int, ...]]

    def awaited(self, index: int) -> Iterator[tuple[int, int]]:
        """The operands of an operation, each with its lag as a time."""
        reads = self.operands[index]
        for k, lag in zip(reads, self.lags.get(index) or (0,) * len(reads), strict=True):
            yield k, lag << CYCLE_BITS

    def ready(self, index: int, times: Sequence[int], default: int) -> int:
        """When an operation has its operands in time; ``default`` where it has none."""
        if index in self.lags:
            return max(times[k] - lag for k, lag in self.awaited(index))
        return max((times[k] for k in self.operands[index]), default=default)

    @property
    def shortest_period(self) -> int:
        """Picoseconds of a period at which every indivisible piece of logic fits into a stage."""
        stages = (o.shortest_stage(tail) for o, tail in zip(self.operators, self.tails, strict=True))
        return self.register + max(stages, default=0)

    @property
    def longest_period(self) -> int:
        """Picoseconds of a period at which the whole step fits into one cycle."""
        ends: list[int] = []
        for reads, operator in zip(self.operands, self.operators, strict=True):
            ends.append(max((ends[k] for k in reads), default=0) + operator.delay)
        whole = (end + tail for end, tail in zip(ends, self.tails, strict=True))
        return self.register + max(whole, default=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """A step at one clock period: the registers that every operator needs, and what it costs.

    ``budget`` is the period without its register. ``lasts[k]`` is the delay of the last stage of
    operation k, its whole delay when no register stands inside.
    """

    step: Step
    budget: int
    registers: tuple[int, ...]
    lasts: tuple[int, ...]

    @property
    def period(self) -> int:
        """The clock period in picoseconds."""
        return self.budget + self.step.register


def step_of(
    typed: TypedGraph | FloatGraph,
    device: Device,
    channels: int,
    on_block: frozenset[int],
    shared: Sharing = NONE_SHARED,
) -> Step:
    """A step with its context in registers for one track, in a memory for several."""
    graph, memory = typed.graph, channels > 1
    library = operators(typed, device, on_block, shared)
    tails = list(delivery(graph, device, shared))
    if memory:
        read, write = (picoseconds(device.delay_ns(kind, 1)) for kind in ("context_read", "context_write"))
        for _, root in graph.states:
            tails[root] = max(tails[root], write)
        library = tuple(
            Operator(kind=operator.kind, pieces=(read,))
            if isinstance(operation, State | StateFlag)
            else operator
            for operation, operator in zip(graph.operations, library, strict=True)
        )
    for who in shared.operations.values():
        # One operator has one length, whatever follows some of its results.
        longest = max(tails[index] for index in who)
        for index in who:
            tails[index] = longest
    return Step(
        graph=graph,
        operators=library,
        operands=tuple(map(operands, graph.operations)),
        tails=tuple(tails),
        register=picoseconds(device.delay_ns("register", 1)),
        context_overhead=int(memory),
        lags={k: lags(o) for k, o in enumerate(graph.operations) if isinstance(o, SumOfProducts)},
    )


def delivery(graph: Graph, device: Device, shared: Sharing) -> tuple[int, ...]:
    """What follows each value in its cycle, in picoseconds, where a shared operator reads it later."""
    kinds = shared.kind()
    way = picoseconds(device.delay_ns("select", 1) + device.delay_ns("context_write", 1)) if kinds else 0
    return tuple(way * any(user in kinds for user in users) for users in graph.users)


def pace(step: Step, period: int) -> Pace:
    """The step at a period of at least ``step.shortest_period`` picoseconds."""
    budget = period - step.register
    held = tuple(
        operator.needed(budget, tail) for operator, tail in zip(step.operators, step.tails, strict=True)
    )
    lasts = tuple(operator.derated(k)[-1] for operator, k in zip(step.operators, held, strict=True))
    return Pace(step=step, budget=budget, registers=held, lasts=lasts)


def earliest(pace: Pace, reads: Mapping[int, int]) -> tuple[list[int], list[int]]:
    """The start cycle and the time of the value of every operation.

    ``reads`` gives the cycle in which each ``State`` and ``StateFlag`` operation is read; inputs come in
    cycle 0.
    """
    starts: list[int] = []
    times: list[int] = []
    for index, operation in enumerate(pace.step.graph.operations):
        ready = pace.step.ready(index, times, reads.get(index, 0) << CYCLE_BITS)
        if isinstance(operation, Constant):
            ready = 0
        start, time = place(
            ready, pace.registers[index], pace.lasts[index], pace.step.tails[index], pace.budget
        )
        starts.append(start)
        times.append(time)
    return starts, times


def least_latency(pace: Pace, reads: Mapping[int, int]) -> int:
    """Cycles from the issue of a step to the last of its results, when no operation waits for its turn."""
    _, times = earliest(pace, reads)
    return 1 + max((times[root] >> CYCLE_BITS for root in pace.step.graph.roots), default=0)


def place(ready: int, registers: int, last: int, tail: int, budget: int) -> tuple[int, int]:
    """The start cycle of an operation whose operands are ready at a time, and the time of its value."""
    cycle, offset = ready >> CYCLE_BITS, ready & OFFSET_MASK
    if offset and (registers or offset + last + tail > budget):
        cycle, offset = cycle + 1, 0
    return cycle, ((cycle + registers) << CYCLE_BITS) + (last if registers else offset + last)


def tight(at: Pace, times: Sequence[int]) -> Pace:
    """The same schedule at the period that its longest stage needs."""
    inner = (
        min(max(operator.derated(count)), at.budget)
        for operator, count in zip(at.step.operators, at.registers, strict=True)
        if count
    )
    last = ((time & OFFSET_MASK) + tail for time, tail in zip(times, at.step.tails, strict=True))
    return pace(at.step, at.step.register + max(chain(inner, last), default=0))
