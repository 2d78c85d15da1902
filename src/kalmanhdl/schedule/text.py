"""A plan as text, and back: cycle and registers before every operation of the typed graph.

    interval = 1
    ...
    operations
      3 1 * %7 = multiply %3 %5 : fixed(24, fraction=12) [-32768, 32767]  # update: K[1,0]
    ...
    units
      multiply %7 %12 %30
      ...
      bus %41 %44

The star marks an operation on multiplier blocks. Units are operators on which several operations take turns,
each for so many cycles where a number stands behind the kind: ``divide:17``. ``multiply/2`` chooses operands
in two steps. On a ``bus`` sums of products leave their units.
"""

import re
from collections import Counter
from collections.abc import Iterable

from kalmanhdl.errors import DesignError
from kalmanhdl.graph.kinds import KINDS
from kalmanhdl.graph.operations import Constant
from kalmanhdl.graph.text import misread
from kalmanhdl.numerics.text import parse_typed_graph, print_typed_graph
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.sharing import Unit

_WHOLE = (
    *("interval", "channels", "distance", "context_overhead"),
    *("recurrence_bound", "least_interval", "least_latency"),
)
_REAL = ("period_ns", "pipelined_period_ns")
_BUS = "bus"


def print_plan(plan: Plan) -> str:
    """The text of a plan."""
    header = [f"{key} = {getattr(plan, key)!r}" for key in (*_WHOLE, *_REAL)]
    heading, *lines = print_typed_graph(plan.typed).split("\n")
    count = len(plan.start)
    placed = [
        f"{plan.start[k]:5d} {plan.registers[k]:2d} {'*' if k in plan.on_multiplier_block else ' '} {line}"
        for k, line in enumerate(lines[:count])
    ]
    units = [f"  {_kind(unit)} {_names(unit.operations)}" for unit in plan.units]
    units += [f"  {_BUS} {_names(bus)}" for bus in plan.buses]
    return "\n".join((*header, heading, *placed, *lines[count:], *(["units", *units] if units else [])))


def _names(indices: Iterable[int]) -> str:
    return " ".join(f"%{index}" for index in indices)


def _kind(unit: Unit) -> str:
    steps = "" if unit.steps == 1 else f"/{unit.steps}"
    return f"{unit.kind}{steps}" if unit.busy == 1 else f"{unit.kind}{steps}:{unit.busy}"


def parse_plan(text: str) -> Plan:
    """The plan that ``print_plan`` wrote. Raises DesignError with the line that is not understood."""
    head, heading, tail = text.partition("\noperations\n")
    tail, _, shared = tail.partition("\nunits\n")
    if not heading:
        raise DesignError("the text has no section 'operations': a plan lists them under that heading")
    numbers = _parse_header(head)
    starts: list[int] = []
    registers: list[int] = []
    blocks: list[int] = []
    bare: list[str] = []
    lines = tail.split("\n")
    # Empty lines keep the numbers of lines in error messages right.
    before = "\n" * (head.count("\n") + 1)
    count = lines.index("states") if "states" in lines else len(lines)
    for number, line in enumerate(lines[:count], start=head.count("\n") + 3):
        found = re.fullmatch(r" *(\d+) +(\d+) ([* ]) (%.*)", line)
        if found is None:
            raise misread(number, line, "cycle, registers and the operation, '3 1   %7 = add %3 %5'")
        if found[3] == "*":
            blocks.append(len(starts))
        starts.append(int(found[1]))
        registers.append(int(found[2]))
        bare.append(found[4])
    units, buses = _parse_units(shared, text.count("\n") - shared.count("\n") + 1, len(starts))
    return Plan(
        typed=parse_typed_graph("\n".join((f"{before}operations", *bare, *lines[count:]))),
        start=tuple(starts),
        registers=tuple(registers),
        on_multiplier_block=frozenset(blocks),
        interval=int(numbers["interval"]),
        channels=int(numbers["channels"]),
        distance=int(numbers["distance"]),
        context_overhead=int(numbers["context_overhead"]),
        recurrence_bound=int(numbers["recurrence_bound"]),
        least_interval=int(numbers["least_interval"]),
        least_latency=int(numbers["least_latency"]),
        period_ns=numbers["period_ns"],
        pipelined_period_ns=numbers["pipelined_period_ns"],
        units=units,
        buses=buses,
    )


def _parse_units(text: str, first: int, count: int) -> tuple[tuple[Unit, ...], tuple[tuple[int, ...], ...]]:
    """The units and the buses."""
    found, buses = list[Unit](), list[tuple[int, ...]]()
    for number, line in enumerate(text.split("\n") if text else [], start=first):
        word, *names = line.split()
        front, colon, busy = word.partition(":")
        kind, slash, steps = front.partition("/")
        indices = [int(name[1:]) for name in names if re.fullmatch(r"%\d+", name)]
        known = (
            kind in (*KINDS, _BUS) and (not colon or busy.isdecimal()) and (not slash or steps in ("1", "2"))
        )
        if not known or not indices or len(indices) < len(names) or max(indices) >= count:
            raise misread(number, line, "a kind and the operations that share it, 'multiply %3 %5'")
        if kind == _BUS:
            buses.append(tuple(indices))
            continue
        found.append(Unit(kind=kind, operations=tuple(indices), busy=int(busy or 1), steps=int(steps or 1)))
    return tuple(found), tuple(buses)


def _parse_header(text: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for number, (line, key) in enumerate(zip(text.split("\n"), (*_WHOLE, *_REAL), strict=False), start=1):
        value = re.fullmatch(rf"{key} = (\d+(?:\.\d+)?(?:e[-+]?\d+)?)", line)
        if value is None:
            raise misread(number, line, f"'{key} = ' and a number")
        found[key] = float(value[1])
    missing = [key for key in (*_WHOLE, *_REAL) if key not in found]
    if missing:
        raise DesignError(f"the text of the plan has no {missing[0]!r}: write '{missing[0]} = ' and a number")
    return found


def table(plan: Plan) -> str:
    """A short table for a person: the figures of a plan, and what starts in every cycle."""
    lines = [
        f"interval {plan.interval}, channels {plan.channels}, recurrence bound {plan.recurrence_bound}, "
        f"distance {plan.distance}, latency {plan.latency} cycles of {plan.period_ns:.2f} ns",
        "cycle  operations that start",
    ]
    cycles: dict[int, Counter[str]] = {}
    for index, operation in enumerate(plan.typed.graph.operations):
        if not isinstance(operation, Constant):
            kinds = cycles.setdefault(plan.start[index], Counter())
            kinds[type(operation).__name__.lower()] += 1
    for cycle, kinds in sorted(cycles.items()):
        started = ", ".join(f"{kind} {number}" for kind, number in sorted(kinds.items()))
        lines.append(f"{cycle:5d}  {started}")
    return "\n".join(lines) + "\n"
