"""Work laid out for the eye: what is of a kind side by side in as few lanes as hold it."""

from collections.abc import Iterable
from dataclasses import dataclass

from kalmanhdl.processor.step import UNITS, Step
from kalmanhdl.schedule.summary import Row

# What a reader knows by name comes first, in this order; other kinds follow.
GROUPS = {
    "sums of products": ("sum_of_products",),
    "multiplications": ("multiply",),
    "divisions and reciprocals": ("divide", "reciprocal"),
    "constant multiplications": ("constant_multiply",),
    "additions and subtractions": ("add", "subtract"),
    "rounding into a format": ("quantise",),
    "selection": ("select",),
    "flags": ("outside", "sum_outside", "negative", "and", "or", "not"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """Something that takes the cycles from ``start`` to ``end``, both with it; what it is and where from."""

    group: str
    start: int
    end: int
    kind: str
    origin: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """Work in its lane, from the start of its first cycle to the end of its last."""

    lane: int
    left: int
    right: int
    work: Work


def lanes(rows: Iterable[Row]) -> tuple[Bar, ...]:
    """The operations of a schedule in lanes, lane 0 on top; each group of kinds has lanes of its own."""
    works = (
        Work(
            group=group_of(row.kind),
            start=row.start,
            end=row.end,
            kind=row.kind.replace("_", " "),
            origin=row.origin,
        )
        for row in rows
    )
    return _laid_out(works, GROUPS)


def step_lanes(step: Step) -> tuple[Bar, ...]:
    """The instructions of a step of a program in lanes; each unit has lanes of its own."""
    works = (
        Work(group=row.unit, start=row.first, end=row.last, kind=row.text, origin=row.does or row.text)
        for row in step.rows
    )
    return _laid_out(works, UNITS)


def _laid_out(works: Iterable[Work], order: Iterable[str]) -> tuple[Bar, ...]:
    groups: dict[str, list[Work]] = {group: [] for group in order}
    for work in works:
        groups.setdefault(work.group, []).append(work)
    bars: list[Bar] = []
    first = 0
    for members in groups.values():
        ends: list[int] = []
        for work in sorted(members, key=lambda work: (work.start, work.end)):
            lane = next((k for k, end in enumerate(ends) if end <= work.start), len(ends))
            ends[lane : lane + 1] = [work.end + 1]
            bars.append(Bar(lane=first + lane, left=work.start, right=work.end + 1, work=work))
        first += len(ends)
    return tuple(bars)


def group_of(kind: str) -> str:
    """The group that a kind of operation belongs to; its own name where there is none."""
    return next((group for group, kinds in GROUPS.items() if kind in kinds), kind.replace("_", " "))
