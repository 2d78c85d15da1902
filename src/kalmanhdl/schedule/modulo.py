"""Modulo scheduling: one step laid out so that the next can be issued ``interval`` cycles later."""

from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.multiply_add import with_sums_of_products
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.allocation import Task, allocated
from kalmanhdl.schedule.attempt import Allocation
from kalmanhdl.schedule.binding import bound as bound_units
from kalmanhdl.schedule.binding import carried
from kalmanhdl.schedule.lifetimes import with_fewer_registers
from kalmanhdl.schedule.multipliers import on_blocks, too_wide
from kalmanhdl.schedule.operator import picoseconds
from kalmanhdl.schedule.placement import Pace, Step, earliest, least_latency, pace, step_of, tight
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.recurrence import recurrence
from kalmanhdl.schedule.wanted import Wanted, refused
from kalmanhdl.target.device import Device


def schedule(typed: TypedGraph | FloatGraph, device: Device, wanted: Wanted) -> Plan:
    """Lay one step out in clock cycles.

    Without shared operators ``interval`` None is the least that lets every track run at its recurrence
    bound. Where ``interval * channels`` is shorter than that bound the pipeline is made shallower: the
    shortest period that allows it, down to all new states in one cycle. With shared operators it is the least
    that was found.

    Raises ScheduleError for an interval, a number of channels, a clock, a number of blocks or of
    operators that cannot be, and for an interval or a latency that no schedule was found for.
    """
    _check(wanted)
    if wanted.units and "multiply_add" in wanted.units and isinstance(typed, TypedGraph):
        typed = with_sums_of_products(typed, device.multiplier_width)
    interval, channels = wanted.interval, wanted.channels
    single_cycle = interval == 1 and channels == 1
    on_block = on_blocks(typed, device, wanted.multiplier_blocks, outputs_in_logic=single_cycle)
    if wanted.units and "multiply" in wanted.units and "multiply" not in wanted.iterative:
        wide = too_wide(typed, device, on_block, wanted.units["multiply"])
    else:
        wide = frozenset[int]()
    on_block -= wide
    step = step_of(typed, device, channels, on_block)
    period = picoseconds(1000 / wanted.clock_mhz if wanted.clock_mhz else device.pipelined_period_ns)
    deep = pace(step, max(period, step.shortest_period))
    task = Task(typed=typed, device=device, on_block=on_block, wide=wide, period=period, wanted=wanted)
    shared = allocated(task)
    if shared is not None:
        return _plan(typed, wanted, on_block, shared)
    bound = recurrence(deep).bound
    if interval is None:
        interval = -(-bound // channels)
    if bound > interval * channels and isinstance(typed, FloatGraph) and typed.clocks:
        raise refused(
            "interval",
            f" is {interval}: with architecture.clocks the loop of the states takes "
            f"{bound} clocks: allow a longer interval, or leave the clocks to the tool",
        )
    chosen = deep if bound <= interval * channels else _shallower(step, deep, interval * channels)
    distance = bound if chosen is deep else recurrence(chosen).bound
    chosen = tight(chosen, _earliest(chosen, distance)[1])
    starts, times = _earliest(chosen, distance)
    return Plan(
        typed=typed,
        start=tuple(with_fewer_registers(typed, chosen, starts, times, distance)),
        registers=chosen.registers,
        on_multiplier_block=on_block,
        interval=interval,
        channels=channels,
        distance=distance,
        context_overhead=step.context_overhead,
        recurrence_bound=bound,
        least_interval=-(-distance // channels),
        least_latency=least_latency(chosen, recurrence(chosen).reads(max(distance, interval * channels))),
        period_ns=chosen.period / 1000,
        pipelined_period_ns=tight(deep, _earliest(deep, bound)[1]).period / 1000,
    )


def _plan(
    typed: TypedGraph | FloatGraph, wanted: Wanted, on_block: frozenset[int], found: Allocation
) -> Plan:
    attempt, turns = found.attempt, found.turns
    at = tight(attempt.pace, turns.times)
    ends = [start + held for start, held in zip(turns.starts, at.registers, strict=True)]
    buses = carried(ends, found.interval, attempt.sharing)
    return Plan(
        typed=typed,
        start=tuple(turns.starts),
        registers=at.registers,
        on_multiplier_block=on_block,
        interval=found.interval,
        channels=wanted.channels,
        distance=turns.distance,
        context_overhead=at.step.context_overhead,
        recurrence_bound=attempt.recurrence_bound,
        least_interval=found.least_interval,
        least_latency=found.least_latency,
        period_ns=at.period / 1000,
        pipelined_period_ns=at.period / 1000,
        units=bound_units(typed, turns.starts, ends, found.interval, attempt.sharing, buses),
        buses=buses,
    )


def _check(wanted: Wanted) -> None:
    interval, clock, blocks = wanted.interval, wanted.clock_mhz, wanted.multiplier_blocks
    if interval is not None and interval < 1:
        raise refused("interval", f" is {interval}: a step takes 1 cycle or more")
    if wanted.channels < 1:
        raise refused("channels", f" is {wanted.channels}: use 1 track or more")
    if clock is not None and not 0 < clock < float("inf"):
        raise refused("clock_mhz", f" is {clock}: use a number of MHz above 0")
    if blocks is not None and blocks < 0:
        raise refused("multiplier_blocks", f" is {blocks}: use 0 blocks or more")


def _shallower(step: Step, deep: Pace, distance: int) -> Pace:
    """The step at the shortest period at which one can follow another after ``distance`` cycles."""
    low, high = deep.period, step.longest_period
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _follows(pace(step, middle), distance) else (middle, high)
    return pace(step, high)


def _follows(candidate: Pace, distance: int) -> bool:
    found = recurrence(candidate)
    # With one cycle a step, an update is asked for in the cycle of its measurement: states that are
    # computed a cycle later would shorten the period a little and double the latency.
    return found.single_cycle if distance == 1 else found.bound <= distance


def _earliest(at: Pace, distance: int) -> tuple[list[int], list[int]]:
    return earliest(at, recurrence(at).reads(distance))
