"""Devices as data: what a part holds and how long its logic takes, as measured by the tools."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

OPERANDS = "operands"
"""The choice of operands before shared operators, which is derated as a kind of its own."""

DERATED = (
    *("add", "subtract", "multiply", "multiply_add", "divide", "reciprocal", "unary"),
    *("quantise", "outside", "select", "table", "shift", "and", "or", "negative", "notfinite"),
    OPERANDS,
)
"""The kinds of operators whose delays can be derated, in the schedule's words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Device:
    """One part at one speed grade.

    ``delays[kind]`` is a table of (size, nanoseconds), sorted by size; kinds: ``add`` (carry chain, by
    width), ``multiply`` (one block), ``compare``, ``select``, ``table`` (logic ROM, by address bits),
    ``shift`` (variable shift, by width), ``leading_one`` (by width), ``context_read`` (clock to data),
    ``context_write``, ``register`` (clock to output plus setup).
    ``areas[kind]`` is a table of (size, LUTs): ``add``, ``select``, ``round`` and ``clamp`` (a quantisation
    with and without an adder before it), ``shift`` and ``leading_one`` by width; ``table`` by address bits,
    for each bit of its rows; ``multiply`` (from logic) by addends times width, ``divide`` by rows times
    width.
    ``package`` is the one that place and route assumes; empty where there is no place and route.
    ``derate[kind]`` is how many times the table's delay a kind of operator, one of ``DERATED``, took where it
    was placed.
    """

    name: str
    grade: int
    family: str
    luts: int
    ffs: int
    multipliers: int
    block_rams: int
    multiplier_width: int
    pipelined_period_ns: float
    delays: dict[str, tuple[tuple[int, float], ...]]
    areas: dict[str, tuple[tuple[int, float], ...]]
    measured_with: str
    package: str = ""
    derate: Mapping[str, float] = field(default_factory=dict)

    def delay_ns(self, kind: str, size: int) -> float:
        """The delay of a piece of logic, between measured sizes by interpolation, beyond by extension."""
        return _between(self.delays[kind], size)

    def area_luts(self, kind: str, size: int) -> float:
        """The LUTs of a piece of logic, between measured sizes by interpolation, beyond by extension."""
        return _between(self.areas[kind], size)


def _between(table: tuple[tuple[int, float], ...], size: int) -> float:
    if len(table) == 1:
        return table[0][1]
    pairs = list(pairwise(table))
    (x0, y0), (x1, y1) = next((p for p in pairs if size <= p[1][0]), pairs[-1])
    return max(0.0, y0 + (y1 - y0) * (size - x0) / (x1 - x0))
