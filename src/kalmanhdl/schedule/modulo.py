"""Modulo scheduling: one step laid out so that the next can be issued ``interval`` cycles later."""

from itertools import chain

from kalmanhdl.errors import ScheduleError
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.lifetimes import with_fewer_registers
from kalmanhdl.schedule.multipliers import on_blocks
from kalmanhdl.schedule.operators import operators, picoseconds
from kalmanhdl.schedule.placement import OFFSET_MASK, Pace, Step, earliest, pace, step_of
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.recurrence import recurrence
from kalmanhdl.target.device import Device


def schedule(
    typed: TypedGraph,
    device: Device,
    interval: int | None,
    channels: int,
    clock_mhz: float | None = None,
    multiplier_blocks: int | None = None,
) -> Plan:
    """Lay one step out in clock cycles, with as many operators as operations.

    Operators are pipelined for ``clock_mhz``, the device's own pipelined period without one. Tracks
    take turns over ``channels``; ``interval`` None is the least that lets every track run at its
    recurrence bound. Where ``interval * channels`` is shorter than that bound the pipeline is made shallower:
    the shortest period that allows it, down to all new states in one cycle. At most
    ``multiplier_blocks`` blocks multiply, the rest is logic.

    Raises ScheduleError for an interval, a number of channels, a clock or a number of blocks that
    cannot be.
    """
    _check(interval, channels, clock_mhz, multiplier_blocks)
    single_cycle = interval == 1 and channels == 1
    on_block = on_blocks(typed, device, multiplier_blocks, outputs_in_logic=single_cycle)
    step = step_of(typed.graph, operators(typed, device, on_block), device, channels)
    wanted = 1000 / clock_mhz if clock_mhz else device.pipelined_period_ns
    deep = pace(step, max(picoseconds(wanted), step.shortest_period))
    bound = recurrence(deep).bound
    if interval is None:
        interval = -(-bound // channels)
    chosen = deep if bound <= interval * channels else _shallower(step, deep, interval * channels)
    distance = bound if chosen is deep else recurrence(chosen).bound
    chosen = _tight(chosen, distance)
    starts, times = earliest(chosen, recurrence(chosen).reads(distance))
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
        period_ns=chosen.period / 1000,
        pipelined_period_ns=_tight(deep, bound).period / 1000,
    )


def _check(
    interval: int | None, channels: int, clock_mhz: float | None, multiplier_blocks: int | None
) -> None:
    if interval is not None and interval < 1:
        raise ScheduleError(f"architecture.interval is {interval}: a step takes 1 cycle or more")
    if channels < 1:
        raise ScheduleError(f"architecture.channels is {channels}: use 1 track or more")
    if clock_mhz is not None and not 0 < clock_mhz < float("inf"):
        raise ScheduleError(f"architecture.clock_mhz is {clock_mhz}: use a number of MHz above 0")
    if multiplier_blocks is not None and multiplier_blocks < 0:
        raise ScheduleError(f"architecture.multiplier_blocks is {multiplier_blocks}: use 0 blocks or more")


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


def _tight(at: Pace, distance: int) -> Pace:
    """The same schedule at the period that its longest stage needs."""
    _, times = earliest(at, recurrence(at).reads(distance))
    inner = (
        max(operator.stages(count))
        for operator, count in zip(at.step.operators, at.registers, strict=True)
        if count
    )
    last = ((time & OFFSET_MASK) + tail for time, tail in zip(times, at.step.tails, strict=True))
    return pace(at.step, at.step.register + max(chain(inner, last), default=0))
