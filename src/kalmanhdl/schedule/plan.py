"""A schedule as a value: when every operation of a step runs."""

from dataclasses import dataclass

from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.sharing import Sharing, Unit, pairs


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """One step of a filter laid out in clock cycles, counted from the issue of the step.

    ``start[k]`` is the cycle in which operation k takes its operands; its value is there, after
    combinational logic, in cycle ``start[k] + registers[k]``, and ``registers[k]`` pipeline registers
    lie inside the operator. Between two operations whose cycles differ the datapath puts registers.
    Constants are there in every cycle (their start is 0 and means nothing).

    A state's ``State`` operation starts in the cycle in which the context gives its value; the state is
    stored at the end of the cycle in which its root is there. ``context_overhead`` is the number of
    further cycles before a stored value can be read (0: the context is a register, 1: a memory).
    The next step of the same track may be issued ``distance`` cycles later, no sooner: for every state
    ``start + distance >= end of root + 1 + context_overhead``.

    ``units`` are operators on which several operations take turns, no two in cycles that are equal modulo
    ``interval``; a shared operator takes its operands into registers of its own, the first of
    ``registers``. Every other operation has an operator of its own. Sums of products leave on ``buses``, each
    the operations whose results it carries, no two in equal cycles.
    """

    typed: TypedGraph | FloatGraph
    start: tuple[int, ...]
    registers: tuple[int, ...]
    # Operations put on a multiplier block; other multiplications are built from logic.
    on_multiplier_block: frozenset[int]
    interval: int
    channels: int
    distance: int
    context_overhead: int
    # The least distance that the deeply pipelined operators allow, and the one with these operators.
    recurrence_bound: int
    # No schedule on these operators has a shorter interval, or at this interval a shorter latency, as far as
    # that is proven: where they are equal to the plan's own it is the best there is.
    least_interval: int
    least_latency: int
    # The estimated longest stage, and the stage of the deeply pipelined operators, in nanoseconds.
    period_ns: float
    pipelined_period_ns: float
    units: tuple[Unit, ...] = ()
    buses: tuple[tuple[int, ...], ...] = ()

    @property
    def sharing(self) -> Sharing:
        """Which operations take turns, and on how many operators of each kind."""
        counts, found = dict[str, int](), dict[str, tuple[int, ...]]()
        for unit in self.units:
            counts[unit.kind] = counts.get(unit.kind, 0) + 1
            found[unit.kind] = (*found.get(unit.kind, ()), *unit.operations)
        return Sharing(
            counts=counts,
            operations={kind: tuple(sorted(who)) for kind, who in found.items()},
            busy={unit.kind: unit.busy for unit in self.units if unit.busy > 1},
            pairs=pairs(self.typed.graph.operations, found.get("multiply_add", ())),
            buses=len(self.buses),
            two_steps=frozenset(unit.kind for unit in self.units if unit.steps > 1),
        )

    def end(self, index: int) -> int:
        """The cycle in which the value of an operation is there."""
        return self.start[index] + self.registers[index]

    @property
    def latency(self) -> int:
        """Cycles from the issue of a step to the last of its outputs, that cycle included."""
        return 1 + max((self.end(index) for index in self.typed.graph.roots), default=0)

    @property
    def shallower(self) -> bool:
        """Whether the pipeline was made shallower so that a track can meet its interval."""
        return self.period_ns > self.pipelined_period_ns
