"""As soon as possible: the earliest time of every operation at one clock period.

A time is ``cycle << CYCLE_BITS | picoseconds`` into the cycle, after the registers at its beginning.
Placing an operation is monotone in the times of its operands and commutes with a shift by whole
cycles, so that the latest of several paths decides and paths can be followed one by one.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from kalmanhdl.graph.operations import Constant, Graph, State, StateFlag, operands
from kalmanhdl.schedule.operators import Operator, picoseconds
from kalmanhdl.target.device import Device

CYCLE_BITS = 40
OFFSET_MASK = (1 << CYCLE_BITS) - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step of a filter as operators: what does not change with the clock period.

    ``tails[k]`` is what must still follow operation k within its last cycle: the write to the context.
    """

    graph: Graph
    operators: tuple[Operator, ...]
    operands: tuple[tuple[int, ...], ...]
    tails: tuple[int, ...]
    register: int
    context_overhead: int

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


def step_of(graph: Graph, operators: tuple[Operator, ...], device: Device, channels: int) -> Step:
    """A step with its context in registers for one track, in a memory for several."""
    memory = channels > 1
    tails = [0] * len(graph.operations)
    if memory:
        read, write = (picoseconds(device.delay_ns(kind, 1)) for kind in ("context_read", "context_write"))
        for _, root in graph.states:
            tails[root] = write
        operators = tuple(
            Operator(kind=operator.kind, pieces=(read,))
            if isinstance(operation, State | StateFlag)
            else operator
            for operation, operator in zip(graph.operations, operators, strict=True)
        )
    return Step(
        graph=graph,
        operators=operators,
        operands=tuple(map(operands, graph.operations)),
        tails=tuple(tails),
        register=picoseconds(device.delay_ns("register", 1)),
        context_overhead=int(memory),
    )


def pace(step: Step, period: int) -> Pace:
    """The step at a period of at least ``step.shortest_period`` picoseconds."""
    budget = period - step.register
    held = tuple(
        next(k for k in range(operator.capacity + 1) if operator.fits(k, budget, tail))
        for operator, tail in zip(step.operators, step.tails, strict=True)
    )
    lasts = tuple(operator.stages(k)[-1] for operator, k in zip(step.operators, held, strict=True))
    return Pace(step=step, budget=budget, registers=held, lasts=lasts)


def earliest(pace: Pace, reads: Mapping[int, int]) -> tuple[list[int], list[int]]:
    """The start cycle and the time of the value of every operation.

    ``reads`` gives the cycle in which each ``State`` and ``StateFlag`` operation is read; inputs come in
    cycle 0.
    """
    starts: list[int] = []
    times: list[int] = []
    for index, operation in enumerate(pace.step.graph.operations):
        ready = max((times[k] for k in pace.step.operands[index]), default=reads.get(index, 0) << CYCLE_BITS)
        if isinstance(operation, Constant):
            ready = 0
        start, time = place(
            ready, pace.registers[index], pace.lasts[index], pace.step.tails[index], pace.budget
        )
        starts.append(start)
        times.append(time)
    return starts, times


def place(ready: int, registers: int, last: int, tail: int, budget: int) -> tuple[int, int]:
    """The start cycle of an operation whose operands are ready at a time, and the time of its value."""
    cycle, offset = ready >> CYCLE_BITS, ready & OFFSET_MASK
    if offset and (registers or offset + last + tail > budget):
        cycle, offset = cycle + 1, 0
    return cycle, ((cycle + registers) << CYCLE_BITS) + (last if registers else offset + last)
