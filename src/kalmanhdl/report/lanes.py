"""A schedule laid out for the eye: operations of a kind side by side in as few lanes as hold them."""

from collections.abc import Iterable
from dataclasses import dataclass

from kalmanhdl.schedule.summary import Row

# What a reader knows by name comes first, in this order; other kinds follow.
GROUPS = {
    "multiplications": ("multiply",),
    "divisions and reciprocals": ("divide", "reciprocal"),
    "constant multiplications": ("constant_multiply",),
    "additions and subtractions": ("add", "subtract"),
    "rounding into a format": ("quantise",),
    "selection": ("select",),
    "flags": ("outside", "negative", "and", "or", "not"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One operation in its lane, from the start of its first cycle to the end of its last."""

    lane: int
    left: int
    right: int
    group: str
    row: Row


def lanes(rows: Iterable[Row]) -> tuple[Bar, ...]:
    """Bars in lanes, lane 0 on top; each group of kinds has lanes of its own."""
    groups: dict[str, list[Row]] = {group: [] for group in GROUPS}
    for row in rows:
        groups.setdefault(group_of(row.kind), []).append(row)
    bars: list[Bar] = []
    first = 0
    for group, members in groups.items():
        ends: list[int] = []
        for row in sorted(members, key=lambda row: (row.start, row.end)):
            lane = next((k for k, end in enumerate(ends) if end <= row.start), len(ends))
            ends[lane : lane + 1] = [row.end + 1]
            bars.append(Bar(lane=first + lane, left=row.start, right=row.end + 1, group=group, row=row))
        first += len(ends)
    return tuple(bars)


def group_of(kind: str) -> str:
    """The group that a kind of operation belongs to; its own name where there is none."""
    return next((group for group, kinds in GROUPS.items() if kind in kinds), kind.replace("_", " "))
