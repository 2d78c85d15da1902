"""Whether a plan keeps what plans promise. Shares nothing with the scheduler but the operator library.

The scheduler works with an operator's registers and last delay, and with Karp's means; the checker follows
every stage of an operator and looks for loops that gain (Floyd 1962): a slip in one is seen by the other.
"""

from collections.abc import Iterator, Sequence
from itertools import count

import numpy as np
import numpy.typing as npt

from kalmanhdl.graph.operations import Constant, Flag, Input, State, StateFlag, SumOfProducts, lags, operands
from kalmanhdl.schedule.operator import Operator, picoseconds
from kalmanhdl.schedule.operators import operators
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.target.device import Device

# A moment of a step: a cycle, and picoseconds after its clock edge.
Moment = tuple[int, int]
# Of a moment in one number: more than the picoseconds of any cycle.
_CYCLE = 1 << 40
# Where no path leads, and what is later than that: operands taken late may be there before the start.
_NOWHERE = -(1 << 61)
_EARLIEST = -(1 << 60)


def problems(plan: Plan, device: Device) -> list[str]:
    """Everything that is wrong with a plan, in words; nothing for a right one."""
    shape = list(_shape(plan))
    if shape:
        return shape
    library = operators(plan.typed, device, plan.on_multiplier_block, plan.sharing)
    return [
        *_sources(plan),
        *_order(plan),
        *_states(plan),
        *_throughput(plan),
        *_turns(plan),
        *_stages(plan, library, device),
        *_bounds(plan, library, device),
        *_leasts(plan),
    ]


def _shape(plan: Plan) -> Iterator[str]:
    operations = len(plan.typed.graph.operations)
    for name, values in (("start", plan.start), ("registers", plan.registers)):
        if len(values) != operations:
            yield f"{name} has {len(values)} entries for {operations} operations"
        for index, value in enumerate(values):
            if value < 0:
                yield f"{name} of {_name(plan, index)} is {value}: use 0 or more"


def _name(plan: Plan, index: int) -> str:
    if index >= len(plan.typed.graph.operations):
        return f"%{index}"
    operation = plan.typed.graph.operations[index]
    return f"%{index} {type(operation).__name__} ({plan.typed.graph.origins[index]})"


def _sources(plan: Plan) -> Iterator[str]:
    for index, operation in enumerate(plan.typed.graph.operations):
        if isinstance(operation, Input | Flag | Constant) and (plan.start[index] or plan.registers[index]):
            yield f"{_name(plan, index)} comes with the step but ends in cycle {plan.end(index)}"


def _order(plan: Plan) -> Iterator[str]:
    graph = plan.typed.graph
    for index, operation in enumerate(graph.operations):
        for k, lag in zip(operands(operation), lags(operation), strict=True):
            if not isinstance(graph.operations[k], Constant) and plan.end(k) > plan.start[index] + lag:
                yield (
                    f"{_name(plan, index)} starts in cycle {plan.start[index]}, before its operand "
                    f"{_name(plan, k)} is there in cycle {plan.end(k)}"
                )


def _reads(plan: Plan) -> dict[str, int]:
    operations = enumerate(plan.typed.graph.operations)
    return {o.name: index for index, o in operations if isinstance(o, State | StateFlag)}


def _states(plan: Plan) -> Iterator[str]:
    reads = _reads(plan)
    for name, root in plan.typed.graph.states:
        if name not in reads:
            continue
        read, stored = plan.start[reads[name]], plan.end(root)
        if read > stored:
            yield f"state {name} is read in cycle {read}, after its next value is stored in cycle {stored}"
        if read + plan.distance < stored + 1 + plan.context_overhead:
            yield (
                f"state {name} is stored in cycle {stored}, too late for a next step after "
                f"{plan.distance} cycles that reads it in its cycle {read}"
            )


def _throughput(plan: Plan) -> Iterator[str]:
    if plan.interval < 1 or plan.channels < 1:
        yield f"interval {plan.interval} and channels {plan.channels}: both are 1 or more"
    if plan.distance > plan.interval * plan.channels:
        yield (
            f"a track returns after {plan.interval} x {plan.channels} cycles, sooner than the distance "
            f"of {plan.distance}"
        )
    if plan.context_overhead != (plan.channels > 1):
        yield f"a context of {plan.channels} channels cannot have an overhead of {plan.context_overhead}"


def _turns(plan: Plan) -> Iterator[str]:
    """Operations that share an operator: one at a time, each on one operator only, all equally long."""
    seen: dict[int, int] = {}
    for number, unit in enumerate(plan.units):
        busy, lengths = dict[int, int](), set[int]()
        for index in unit.operations:
            operation = plan.typed.graph.operations[index]
            pairs = len(operation.terms) if isinstance(operation, SumOfProducts) else 1
            lengths.add(plan.registers[index] - pairs)
            for cycle in range(plan.start[index], plan.start[index] + max(unit.busy, pairs)):
                phase = cycle % plan.interval
                if phase in busy:
                    yield (
                        f"{_name(plan, index)} and {_name(plan, busy[phase])} both take operator {number} in "
                        f"cycle {phase} of the interval"
                    )
                busy[phase] = index
            if index in seen:
                yield f"{_name(plan, index)} is on operators {seen[index]} and {number}"
            seen[index] = number
            if unit.busy > 1 and plan.registers[index] != unit.busy + unit.steps:
                yield f"{_name(plan, index)} holds {plan.registers[index]} registers for {unit.busy} clocks"
        if len(lengths) != 1:
            yield f"operator {number} ({unit.kind}) has operations of different length, or none"
        if any(plan.registers[index] < unit.steps for index in unit.operations):
            yield f"operator {number} ({unit.kind}) has no registers for its operands"
    yield from _leaving(plan)


def _leaving(plan: Plan) -> Iterator[str]:
    """Sums of products leave on one bus each, one at a time."""
    sums = [k for unit in plan.units if unit.kind == "multiply_add" for k in unit.operations]
    if sorted(sums) != sorted(index for bus in plan.buses for index in bus):
        yield "the buses do not carry every sum of products once"
    for number, bus in enumerate(plan.buses):
        leaves = dict[int, int]()
        for index in bus:
            phase = plan.end(index) % plan.interval
            if phase in leaves:
                yield (
                    f"{_name(plan, index)} and {_name(plan, leaves[phase])} both leave on bus {number} in "
                    f"cycle {phase} of the interval"
                )
            leaves[phase] = index


def _tails(plan: Plan, device: Device) -> list[int]:
    """What follows each value in its last stage: the way to the context, or to a shared operator."""
    turns = {index for unit in plan.units for index in unit.operations}
    way = picoseconds(device.delay_ns("select", 1) + device.delay_ns("context_write", 1))
    found = [0] * len(plan.start)
    for index in turns:
        for k in operands(plan.typed.graph.operations[index]):
            found[k] = way
    for _, root in plan.typed.graph.states:
        found[root] = max(found[root], _context_delays(plan, device)[1])
    for kind in {unit.kind for unit in plan.units}:
        alike = [index for unit in plan.units if unit.kind == kind for index in unit.operations]
        worst = max(found[index] for index in alike)
        for index in alike:
            found[index] = worst
    return found


def _stages(plan: Plan, library: tuple[Operator, ...], device: Device) -> Iterator[str]:
    """Chains of logic between registers, in the cycles that the plan gives them."""
    read, _, register = _context_delays(plan, device)
    limit = picoseconds(plan.period_ns) - register
    values: list[Moment] = []
    tails = _tails(plan, device)
    for index, operation in enumerate(plan.typed.graph.operations):
        held = plan.registers[index]
        if held > library[index].capacity:
            yield f"{_name(plan, index)} holds {held} registers, but has room for {library[index].capacity}"
            return
        begin = plan.start[index]
        chained = [
            values[k][1]
            for k, lag in zip(operands(operation), lags(operation), strict=True)
            if values[k][0] == begin + lag
        ]
        parts = list(library[index].stages(held))
        if isinstance(operation, State | StateFlag):
            parts[0] += read
        parts[0] += max(chained, default=0)
        values.append((begin + held, parts[-1]))
        longest = max(*parts, parts[-1] + tails[index])
        if longest > limit:
            yield (
                f"{_name(plan, index)} ends a stage of {longest + register} ps, longer than the period of "
                f"{plan.period_ns} ns"
            )


def _context_delays(plan: Plan, device: Device) -> tuple[int, int, int]:
    read, write, register = (
        picoseconds(device.delay_ns(kind, 1)) for kind in ("context_read", "context_write", "register")
    )
    return (read, write, register) if plan.channels > 1 else (0, 0, register)


def _bounds(plan: Plan, library: tuple[Operator, ...], device: Device) -> Iterator[str]:
    least = 1 + plan.context_overhead if plan.typed.graph.states else 1
    deep = _edges(plan, library, device, plan.pipelined_period_ns)
    if plan.recurrence_bound < least or _gains(deep, plan.recurrence_bound):
        yield f"no schedule of {plan.pipelined_period_ns} ns reaches the bound of {plan.recurrence_bound}"
    if plan.recurrence_bound > least and not _gains(deep, plan.recurrence_bound - 1):
        yield f"the recurrence bound of {plan.recurrence_bound} is not the least"
    here = _edges(plan, library, device, plan.period_ns)
    if plan.distance < least or _gains(here, plan.distance):
        yield f"no schedule of {plan.period_ns} ns reaches the distance of {plan.distance}"


def _leasts(plan: Plan) -> Iterator[str]:
    """What is said to be the least must not be more than what there is, nor less than operators allow."""
    for word, least, found in (
        ("interval", plan.least_interval, plan.interval),
        ("latency", plan.least_latency, plan.latency),
    ):
        if not 1 <= least <= found:
            yield f"the least {word} of {least} is not between 1 and that of {found}"
    if plan.least_interval < plan.sharing.bound:
        least = plan.sharing.bound
        yield f"operators allow no interval below {least}, so {plan.least_interval} is not the least"


def _gains(edges: npt.NDArray[np.float64], distance: int) -> bool:
    """Whether a loop of states takes longer than its steps are apart."""
    paths = edges - distance
    for middle in range(len(paths)):
        paths = np.maximum(paths, paths[:, middle, None] + paths[middle])
        if (np.diagonal(paths) > 0).any():
            return True
    return False


def _edges(
    plan: Plan, library: tuple[Operator, ...], device: Device, period_ns: float
) -> npt.NDArray[np.float64]:
    """Cycles from reading one state until the next value of another can be read, at any period."""
    graph, reads = plan.typed.graph, _reads(plan)
    edges = np.full((len(graph.states), len(graph.states)), -np.inf)
    delays = _context_delays(plan, device)
    limit = picoseconds(period_ns) - delays[2]
    tails = _tails(plan, device)
    depths = _depths(library, tails, limit)
    parts = [operator.derated(depth) for operator, depth in zip(library, depths, strict=True)]
    before = [list(zip(operands(o), lags(o), strict=True)) for o in graph.operations]
    rows = [row for row, (name, _) in enumerate(graph.states) if name in reads]
    sources = [reads[graph.states[row][0]] for row in rows]
    ends = _walk(parts, before, tails, limit, sources, delays[0])
    for column, (_, root) in enumerate(graph.states):
        edges[rows, column] = np.where(
            ends[root] < _EARLIEST, -np.inf, ends[root] + 1 + plan.context_overhead
        )
    return edges


def _depths(library: tuple[Operator, ...], tails: Sequence[int], limit: int) -> list[int]:
    """The fewest registers with which every operator fits into the period."""

    def fits(index: int, held: int) -> bool:
        parts = library[index].derated(held)
        return max(*parts, parts[-1] + tails[index]) <= limit

    return [
        next(k for k in count(operator.fewest) if k >= operator.capacity or fits(index, k))
        for index, operator in enumerate(library)
    ]


def _walk(
    parts: Sequence[Sequence[int]],
    before: Sequence[Sequence[tuple[int, int]]],
    tails: Sequence[int],
    limit: int,
    sources: Sequence[int],
    read: int,
) -> list[npt.NDArray[np.int64]]:
    """The earliest end cycle of every operation after each of ``sources`` is read in cycle 0.

    Below ``_EARLIEST`` there is no path. ``before`` gives the operands with their lags.
    """
    ends: list[npt.NDArray[np.int64]] = []
    own = {source: np.where(np.arange(len(sources)) == k, read, _NOWHERE) for k, source in enumerate(sources)}
    nowhere = np.full(len(sources), _NOWHERE)
    for index, ((first, *rest), reads) in enumerate(zip(parts, before, strict=True)):
        ready = np.max([ends[k] - lag * _CYCLE for k, lag in reads], axis=0) if reads else nowhere
        offset = ready % _CYCLE
        late = (offset > 0) & (bool(rest) | (offset + first + tails[index] > limit))
        begin = np.where(late, ready - offset + _CYCLE, ready)
        end = begin - begin % _CYCLE + len(rest) * _CYCLE + rest[-1] if rest else begin + first
        ends.append(np.where(ready < _EARLIEST, own.get(index, _NOWHERE), end))
    return [end // _CYCLE for end in ends]
