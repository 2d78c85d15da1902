"""What a report says about a plan, in numbers."""

import re
from collections import Counter
from dataclasses import dataclass

from kalmanhdl.graph.operations import (
    Bits,
    Constant,
    Flag,
    Graph,
    Input,
    Multiply,
    Shift,
    State,
    StateFlag,
    lags,
    operands,
)
from kalmanhdl.schedule.lifetimes import result_cycle, widths
from kalmanhdl.schedule.operator import picoseconds
from kalmanhdl.schedule.operators import operators
from kalmanhdl.schedule.placement import pace, step_of
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.recurrence import recurrence
from kalmanhdl.schedule.sharing import Unit, core
from kalmanhdl.schedule.storage import ports, standing
from kalmanhdl.target.device import Device


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One operation of a Gantt chart, from its first cycle to its last."""

    label: str
    kind: str
    start: int
    end: int
    origin: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """A plan in numbers.

    ``units`` counts the operators of each kind; ``turns`` how many operations of a kind take turns on those
    that are shared, which no interval below ``operator_bound_cycles`` allows; sums of products leave on
    ``buses``. It is proven that no schedule
    on them has less than ``least_interval_cycles``, or, at this interval, than ``least_latency_cycles``.
    ``memory_bits`` keep their operands. ``busy[cycle]`` the operations of each kind that start
    in a cycle. ``register_bits`` are held between operators, ``operator_register_bits`` inside them, as
    wide as their results. ``loop`` names the states whose loop sets the bound, or, where the
    pipeline was made shallower, the period.
    """

    interval_cycles: int
    channels: int
    distance_cycles: int
    latency_cycles: int
    recurrence_bound_cycles: int
    least_interval_cycles: int
    least_latency_cycles: int
    period_ns: float
    pipelined_period_ns: float
    shallower: bool
    operator_bound_cycles: int
    units: dict[str, int]
    turns: dict[str, int]
    buses: int
    busy: tuple[dict[str, int], ...]
    multiplier_blocks: int
    register_bits: int
    operator_register_bits: int
    memory_bits: int
    loop: tuple[str, ...]
    rows: tuple[Row, ...]


def summarise(plan: Plan, device: Device) -> Summary:
    """The numbers of a plan for a device."""
    rows = tuple(_rows(plan))
    library = operators(plan.typed, device, plan.on_multiplier_block, plan.sharing)
    bits = widths(plan.typed)
    busy = [Counter(row.kind for row in rows if row.start == cycle) for cycle in range(plan.latency)]
    return Summary(
        interval_cycles=plan.interval,
        channels=plan.channels,
        distance_cycles=plan.distance,
        latency_cycles=plan.latency,
        recurrence_bound_cycles=plan.recurrence_bound,
        least_interval_cycles=plan.least_interval,
        least_latency_cycles=plan.least_latency,
        period_ns=plan.period_ns,
        pipelined_period_ns=plan.pipelined_period_ns,
        shallower=plan.shallower,
        operator_bound_cycles=plan.sharing.bound,
        units=_sorted(_units(plan, rows)),
        turns={kind: len(who) for kind, who in sorted(plan.sharing.operations.items())},
        buses=len(plan.buses),
        busy=tuple(map(_sorted, busy)),
        multiplier_blocks=sum(library[index].blocks for index in _built(plan) & plan.on_multiplier_block),
        register_bits=_register_bits(plan, bits),
        operator_register_bits=sum(_inside(plan, index) * bits[index] for index in _built(plan)),
        memory_bits=sum(_memory_bits(plan, unit) for unit in plan.units),
        loop=_critical_loop(plan, device),
        rows=rows,
    )


def _units(plan: Plan, rows: tuple[Row, ...]) -> Counter[str]:
    """Operators by kind: one for every operation that takes no turns, and the shared ones."""
    built = {f"%{index}" for index in _built(plan)}
    shared = {f"%{index}" for unit in plan.units for index in unit.operations}
    found = Counter(row.kind for row in rows if row.label in built - shared)
    return found + Counter(plan.sharing.counts)


def _built(plan: Plan) -> frozenset[int]:
    """An operation for every operator: of those that take turns the first."""
    waiting = {index for unit in plan.units for index in unit.operations[1:]}
    return frozenset(range(len(plan.start))) - waiting


def _inside(plan: Plan, index: int) -> int:
    """The registers one after the other in an operator."""
    return plan.registers[index] - plan.sharing.pairs.get(index, 1) + 1


def _register_bits(plan: Plan, bits: list[int]) -> int:
    """What stands in registers between operators: neither where it is made nor in a memory."""
    operations, ends = plan.typed.graph.operations, list(map(plan.end, range(len(plan.start))))
    filed = {
        (read.operation, read.value)
        for unit in plan.units
        for port in ports(plan, unit)
        for read in port.reads
        if read.file is not None
    }
    last, leave = list(ends), result_cycle(plan.typed.graph, ends)
    for index, operation in enumerate(operations):
        for k, lag in zip(operands(operation), lags(operation), strict=True):
            if (index, k) not in filed:
                last[k] = max(last[k], plan.start[index] + lag)
    for _, root in plan.typed.graph.outputs:
        last[root] = leave
    return sum(
        width * -(-(read - end) // plan.interval)
        for width, read, end, stood in zip(bits, last, ends, standing(plan), strict=True)
        if read > stood
    )


def _memory_bits(plan: Plan, unit: Unit) -> int:
    operands = core(plan.typed, unit.kind, plan.sharing.operations[unit.kind]).operands
    return sum(
        file.slots * file.turns * operand.form.width
        for port, operand in zip(ports(plan, unit), operands, strict=True)
        for file in port.files
    )


def kind_of(graph: Graph, index: int) -> str:
    """The word for an operation in reports, such as ``constant_multiply``."""
    operation = graph.operations[index]
    if isinstance(operation, Multiply) and any(
        isinstance(graph.operations[k], Constant) for k in operands(operation)
    ):
        return "constant_multiply"
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(operation).__name__).lower()


def _rows(plan: Plan) -> list[Row]:
    graph = plan.typed.graph
    return [
        Row(
            label=f"%{index}",
            kind=kind_of(graph, index),
            start=plan.start[index],
            end=plan.end(index),
            origin=graph.origins[index],
        )
        for index, operation in enumerate(graph.operations)
        if not isinstance(operation, Input | Flag | State | StateFlag | Constant | Shift | Bits)
    ]


def _sorted(counts: Counter[str]) -> dict[str, int]:
    return dict(sorted(counts.items()))


def _critical_loop(plan: Plan, device: Device) -> tuple[str, ...]:
    step = step_of(plan.typed, device, plan.channels, plan.on_multiplier_block, plan.sharing)
    period = picoseconds(plan.period_ns)
    if plan.shallower:
        return recurrence(pace(step, period - 1)).loop(plan.distance)
    return recurrence(pace(step, period)).loop(plan.distance - 1)
