"""Rounds of scheduling and placing until the clock that was asked for is reached.

What nextpnr says of the longest path becomes a factor on the device's table: this kind of operator took so
many times the delay that the table says, or at least so much more that its stage is cut. The scheduler then
gives it the registers that this needs. Nothing else is changed, so that every round is a design that could
have been written by hand (``[target] derate``).
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil

from kalmanhdl.closure.path import Part, Reader, Reading
from kalmanhdl.design import MAX_DERATE, Design
from kalmanhdl.errors import ScheduleError, ToolError
from kalmanhdl.pipeline import Hardware, Implemented, Progress, implement, planned, realised, silent
from kalmanhdl.schedule.plan import Plan

# By how much a factor grows at the least, and how often until a kind of operator is given up.
_GROWTH = 1.15
_TRIES = 6
# Periods are told in whole picoseconds.
_A_PICOSECOND = 0.001


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """One placement: its schedule, its clock, and what its longest path ran through.

    ``change`` says what was changed before it, nothing in the first. ``step_ns`` is the time from one step to
    the next, at a clock that counts no more than was asked for.
    """

    change: str
    interval_cycles: int
    latency_cycles: int
    reached_mhz: float
    step_ns: float
    critical: tuple[Part, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Closure:
    """The rounds, the number of the one that was kept, and why there were no more."""

    asked_mhz: float
    rounds: tuple[Round, ...]
    kept: int
    stopped: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closed:
    """The hardware that was kept, with its placements, and how it was found."""

    hardware: Hardware
    implemented: Implemented
    closure: Closure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tried:
    hardware: Hardware
    implemented: Implemented
    reading: Reading
    round: Round


@dataclass(frozen=True, slots=True, kw_only=True)
class _Change:
    """A design whose schedule differs where the longest path was."""

    design: Design
    plan: Plan
    words: str


Place = Callable[[Hardware, Progress], Implemented]


def close(hardware: Hardware, progress: Progress = silent, place: Place = implement) -> Closed:
    """Place, and while the clock asked for is missed give latency to what the longest path runs through.

    Kept is the round in which steps follow each other soonest, at a clock that counts no more than was asked
    for; of equal ones that of the shortest latency. Its design has the factors, and no rounds left to go.
    Raises ToolError where the first placement fails.
    """
    asked, most = hardware.design.architecture.clock_mhz, hardware.design.target.rounds
    assert asked is not None, "checked with the design"
    tried = [_tried(hardware, place(hardware, progress), asked, "")]
    while isinstance(follows := _after(tried, asked, most, progress), _Change):
        made = realised(follows.design, hardware.numbers, follows.plan, progress)
        try:
            tried.append(_tried(made, place(made, progress), asked, follows.words))
        except ToolError as error:
            # Such as a device that is too small for more registers: what was placed before stands.
            follows = f"{follows.words}: {error}"
            break
    rounds = tuple(one.round for one in tried)
    kept = min(range(len(rounds)), key=lambda k: (*_merit(rounds[k], asked), k))
    best = tried[kept]
    design = best.hardware.design
    seconds = sum((Counter(one.implemented.seconds) for one in tried), Counter[str]())
    return Closed(
        hardware=replace(
            best.hardware,
            design=replace(design, target=replace(design.target, rounds=0)),
            seconds=hardware.seconds,
        ),
        implemented=replace(best.implemented, seconds=dict(seconds)),
        closure=Closure(asked_mhz=asked, rounds=rounds, kept=kept, stopped=follows),
    )


def _tried(hardware: Hardware, implemented: Implemented, asked: float, change: str) -> _Tried:
    plan, reached = hardware.plan, implemented.best.fmax_mhz
    reading = Reader(plan, hardware.design.target.part).read(implemented.best.critical_path)
    found = Round(
        change=change,
        interval_cycles=plan.interval,
        latency_cycles=plan.latency,
        reached_mhz=reached,
        step_ns=plan.interval * 1000 / min(reached, asked),
        critical=reading.parts,
    )
    return _Tried(hardware=hardware, implemented=implemented, reading=reading, round=found)


def _merit(one: Round, asked: float) -> tuple[float, float]:
    return one.step_ns, one.latency_cycles / min(one.reached_mhz, asked)


def _after(tried: Sequence[_Tried], asked: float, most: int, progress: Progress) -> _Change | str:
    """What is tried next; else why nothing is."""
    last = tried[-1]
    if last.round.reached_mhz >= asked:
        return "the clock is reached"
    if len(tried) > most:
        return f"{most} {'round was' if most == 1 else 'rounds were'} asked for"
    if not last.reading.parts:
        return "the longest path runs through no operator, so that latency is no remedy"
    progress(f"{last.round.reached_mhz:.1f} of {asked:g} MHz in round {len(tried)}: scheduling anew")
    soonest = min(one.round.step_ns for one in tried)
    problems: list[str] = []
    for part in last.reading.parts:
        found = _changed(last, part, asked, soonest)
        if isinstance(found, _Change):
            return found
        problems.append(found)
    return "; ".join(problems)


def _changed(last: _Tried, part: Part, asked: float, soonest: float) -> _Change | str:
    """A schedule that cuts the path at a kind of operator; else why there is none."""
    hardware, where = last.hardware, f"{part.kind} ({part.name})"
    design = hardware.design
    if part.kind in (design.architecture.clocks or {}):
        return f"{where}: architecture.clocks says how many clocks it takes"
    reader = Reader(hardware.plan, design.target.part)
    alone = f"{where}: it has its stages for itself, and they cannot be cut"
    if reader.full(part.kind, last.reading.operations):
        return alone
    shape = reader.shape(last.reading.operations)
    for factor in _factors(last, part):
        derated = replace(
            design, target=replace(design.target, derate={**design.target.derate, part.kind: factor})
        )
        try:
            plan = planned(derated, hardware.numbers)
        except ScheduleError as error:
            return f"{where}: {error}"
        if Reader(plan, derated.target.part).shape(last.reading.operations) == shape:
            continue
        problem = _refused(plan, hardware.plan, asked, soonest)
        words = f"{where}: {factor:g} times the delay of the device's table"
        return f"{where}: {problem}" if problem else _Change(design=derated, plan=plan, words=words)
    return alone


def _factors(last: _Tried, part: Part) -> list[float]:
    """Factors to try, from what was measured on."""
    before = last.hardware.design.target.derate.get(part.kind, 1.0)
    grown = max(_GROWTH, last.reading.measured_ns / last.reading.expected_ns)
    tries = (before * grown * _GROWTH**k for k in range(_TRIES))
    return [ceil(100 * factor) / 100 for factor in tries if factor <= MAX_DERATE]


def _refused(plan: Plan, before: Plan, asked: float, soonest: float) -> str:
    """Why a schedule is not worth placing; nothing where it is."""
    if plan.period_ns > max(1000 / asked, before.period_ns) + _A_PICOSECOND:
        return f"the interval of {plan.interval} leaves the loop of the states no more clocks"
    if (at_best := plan.interval * 1000 / asked) >= soonest:
        return (
            f"with more latency a step takes {at_best:.1f} ns at the least, and {soonest:.1f} ns were reached"
        )
    return ""
