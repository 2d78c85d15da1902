"""Integers of the generated C, with overloaded operators and exact bounds.

Every operation on a ``Value`` writes one C statement, a call of ``engine.h`` on many tracks at once, and
returns a new value that knows the least and the greatest integer it can be. The C type follows from these
bounds, so that nothing can overflow, for any word length. ``arithmetic.fixed`` called on such values writes
its own definition as C.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import pairwise


class Kind(IntEnum):
    """A C integer type; the number is its bits (without meaning for WIDE)."""

    INT32 = 32
    INT64 = 64
    INT128 = 128
    WIDE = 1 << 30

    @property
    def c_type(self) -> str:
        """The type of ``engine.h`` that holds one such integer for each track of a group."""
        return "iwide" if self is Kind.WIDE else f"i{self.value}"


FLAG = Kind.INT32.c_type


def signed_bits(low: int, high: int) -> int:
    """The bits, with the sign, of a two's complement number that holds both integers."""
    return 1 + max((~low if low < 0 else low).bit_length(), (~high if high < 0 else high).bit_length())


@dataclass(frozen=True, slots=True)
class Statement:
    """The definition of a C variable."""

    c_type: str
    name: str
    expression: str

    @property
    def text(self) -> str:
        """The definition as C."""
        return f"const {self.c_type} {self.name} = {self.expression};"


@dataclass(slots=True)
class Writer:
    """Collects the C statements of one step.

    ``minimum_bits`` forces wider types than the bounds ask for, which must not change any result.
    ``widest`` is the number of bits that the widest value needed. ``tables`` names the arrays of
    ``int32_t`` that the statements read, by their contents.

    An ``optimistic`` step takes values to be inside of their limits and only looks whether they are, which
    is less to compute: where ``surprises`` is true, nothing that the step gave means anything. What such
    a step then computes with may be any integer of its type.
    """

    minimum_bits: int = 0
    optimistic: bool = False
    widest: int = 0
    statements: list[Statement] = field(default_factory=list)
    tables: dict[tuple[int, ...], str] = field(default_factory=dict)
    _names: dict[tuple[str, str], str] = field(default_factory=dict)
    _above: dict[tuple[Kind, int], str] = field(default_factory=dict)
    _expected: set[tuple[str, int]] = field(default_factory=set)

    def kind(self, low: int, high: int) -> Kind:
        """The narrowest type that holds both integers, at least ``minimum_bits`` wide."""
        bits = max(signed_bits(low, high), self.minimum_bits)
        self.widest = max(self.widest, bits)
        return next(kind for kind in Kind if bits <= kind)

    def bind(self, c_type: str, expression: str) -> str:
        """The name of a variable that holds an expression; equal expressions share one."""
        key = (c_type, expression)
        if key not in self._names:
            self._names[key] = name = f"v{len(self._names)}"
            self.statements.append(Statement(c_type, name, expression))
        return self._names[key]

    def value(self, expression: str, kind: Kind, low: int, high: int) -> "Value":
        """A value of an expression whose C type is ``kind`` and whose integers lie in low..high."""
        if low == high:
            return Value(self, None, low, high)
        to = self.kind(low, high)
        return Value(self, self.bind(to.c_type, cast(expression, kind, to)), low, high)

    def table(self, rows: tuple[int, ...]) -> str:
        """The name of the array with these contents; equal tables are one."""
        return self.tables.setdefault(rows, f"table_{len(self.tables)}")

    def literal(self, number: int) -> "Value":
        """A value known when the C is written."""
        return Value(self, None, number, number)

    def expect(self, value: "Value", low: int, bits: int) -> None:
        """Be surprised where a value is not from ``low`` up to less than ``2**bits`` above it."""
        kind = value.kind
        place = (kind, bits)
        offset = value.at(kind)
        if low:
            offset = f"subtract_{kind.c_type}({offset}, {literal_text(low, kind)})"
        if (offset, bits) in self._expected:
            return
        self._expected.add((offset, bits))
        before = self._above.get(place)
        self._above[place] = self.bind(kind.c_type, f"{before} | {offset}" if before else offset)

    @property
    def surprises(self) -> list[str]:
        """Expressions of which one is not 0 where a value was not where it was expected."""
        found = []
        for (kind, bits), name in self._above.items():
            above = self.bind(kind.c_type, f"right_{kind.c_type}({name}, {bits})")
            if kind is Kind.INT64 and bits < Kind.INT32:
                above = self.bind(kind.c_type, f"{above} | right_{kind.c_type}({above}, {Kind.INT32})")
            found.append(cast(above, kind, Kind.INT32))
        return found

    def flag(self, expression: str) -> "Flag":
        """A flag of an expression that is 0 or -1."""
        return Flag(self, self.bind(FLAG, expression), None)


def cast(text: str, kind: Kind, to: Kind) -> str:
    """An expression of one type as another; the number must fit both."""
    path = [k for k in Kind if min(kind, to) <= k <= max(kind, to)]
    for one, another in pairwise(path if kind < to else path[::-1]):
        text = f"{another.c_type}_of_{one.c_type}({text})"
    return text


def literal_text(number: int, kind: Kind) -> str:
    """A constant as C."""
    return f"all_{kind.c_type}({_element(number, kind)})"


def _element(number: int, kind: Kind) -> str:
    shifts = range(0, signed_bits(number, number), 64)
    words = [f"{number >> shift & (1 << 64) - 1:#x}ULL" for shift in shifts]
    if kind <= Kind.INT64:
        return f"(int{kind.value}_t){words[0]}"
    if len(words) <= 2:
        high = words[1] if len(words) == 2 else f"{-1 if number < 0 else 0}"
        text = f"(__int128)((unsigned __int128){high} << 64 | {words[0]})"
        return f"wide_of({text})" if kind is Kind.WIDE else text
    if number < 0:  # Limbs left out of an initialiser would be zero, not the sign.
        return f"wide_negate({_element(-number, kind)})"
    return "(wide){{" + ", ".join(words) + "}}"


@dataclass(frozen=True, slots=True, eq=False)
class Value:
    """A C integer between ``low`` and ``high``; without ``text`` it is the constant ``low``.

    ``terms``, if there are any, are values with shifts to the left and signs, whose sum it is.
    """

    writer: Writer
    text: str | None
    low: int
    high: int
    terms: "tuple[Term, ...]" = ()

    @property
    def kind(self) -> Kind:
        """Its C type."""
        return self.writer.kind(self.low, self.high)

    def at(self, kind: Kind) -> str:
        """The value as a C expression of a type."""
        return literal_text(self.low, kind) if self.text is None else cast(self.text, self.kind, kind)

    def known(self, low: int, high: int) -> "Value":
        """The same value, of which more is known than its operands tell."""
        low, high = max(low, self.low), min(high, self.high)
        return self.writer.value(self.at(self.kind), self.kind, low, high)

    def lift(self, other: "Value | int") -> "Value":
        """The other operand as a value."""
        return self.writer.literal(other) if isinstance(other, int) else other

    def _call(self, name: str, other: "Value", low: int, high: int) -> "Value":
        kind = max(self.kind, other.kind, self.writer.kind(low, high))
        text = f"{name}_{kind.c_type}({self.at(kind)}, {other.at(kind)})"
        return self.writer.value(text, kind, low, high)

    def _sum(self, name: str, other: "Value", low: int, high: int) -> "Value":
        value = self._call(name, other, low, high)
        if value.text is None or value.kind is Kind.INT32:
            return value
        turned = name == "subtract"
        others = (replace(term, is_negative=term.is_negative != turned) for term in other._parts)
        terms = (*self._parts, *others)
        return replace(value, terms=terms) if len(terms) <= _TERMS else value

    @property
    def _parts(self) -> "tuple[Term, ...]":
        return self.terms or (Term(self, 0),)

    def __add__(self, other: "Value | int") -> "Value":
        other = self.lift(other)
        if other.low == other.high == 0:
            return self
        if self.low == self.high == 0:
            return other
        return self._sum("add", other, self.low + other.low, self.high + other.high)

    def __sub__(self, other: "Value | int") -> "Value":
        other = self.lift(other)
        return self._sum("subtract", other, self.low - other.high, self.high - other.low)

    def __rsub__(self, other: int) -> "Value":
        return self.lift(other) - self

    def __mul__(self, other: "Value | int") -> "Value":
        other = self.lift(other)
        corners = [a * b for a in (self.low, self.high) for b in (other.low, other.high)]
        return self._call("multiply", other, min(corners), max(corners))

    def __lshift__(self, count: int) -> "Value":
        low, high = self.low << count, self.high << count
        kind = self.writer.kind(low, high)
        if count == 0 or low == high:
            return self.writer.value(self.at(kind), kind, low, high)
        value = self.writer.value(f"left_{kind.c_type}({self.at(kind)}, {count})", kind, low, high)
        return replace(value, terms=tuple(replace(term, shift=term.shift + count) for term in self._parts))

    def __rshift__(self, count: int) -> "Value":
        kind = self.kind
        if self.terms and (shorter := _shifted_by_terms(self, count)):
            return shorter
        text = f"right_{kind.c_type}({self.at(kind)}, {min(count, kind - 1)})"
        return self.writer.value(text, kind, self.low >> count, self.high >> count)

    def clamped(self, low: int, high: int) -> "Value":
        """The nearest value within limits."""
        value = self
        if value.low < low:
            value = value._call("maximum", self.lift(low), low, max(low, value.high))
        if value.high > high:
            value = value._call("minimum", self.lift(high), min(high, value.low), high)
        return value

    def limited(self, low: int, high: int) -> "tuple[Value, Flag]":
        """The nearest value within limits, and whether that is another one; see ``Writer``."""
        if low <= self.low and self.high <= high:
            return self, Flag(self.writer, "", False)
        if self._is_expected(low, high):
            self.writer.expect(self, low, (high - low).bit_length())
            return self.known(low, high), Flag(self.writer, "", False)
        value = self.clamped(low, high)
        return value, value.differs(self)

    def _is_expected(self, low: int, high: int) -> bool:
        kind, size = self.kind, high - low + 1
        fits = size & (size - 1) == 0 and kind <= Kind.INT64 and high < 1 << kind - 1
        return self.writer.optimistic and fits and low <= self.high and self.low <= high

    def forced(self, low: int, high: int) -> "Value":
        """The value, within limits whatever it is in an optimistic step."""
        if not self.writer.optimistic or self.text is None:
            return self
        value, kind = self, self.kind
        for name, limit in (("maximum", low), ("minimum", high)):
            text = f"{name}_{kind.c_type}({value.at(kind)}, {literal_text(limit, kind)})"
            value = Value(self.writer, self.writer.bind(kind.c_type, text), self.low, self.high)
        return value

    def __and__(self, mask: int) -> "Value":
        if self.low >= 0 and self.high <= mask and mask & (mask + 1) == 0:
            return self
        return self._call("and", self.lift(mask), 0, mask if self.low < 0 else min(mask, self.high))

    def __xor__(self, mask: int) -> "Value":
        assert self.low >= 0
        return self._call(
            "xor", self.lift(mask), 0, (1 << max(self.high.bit_length(), mask.bit_length())) - 1
        )

    def __lt__(self, other: "Value | int") -> "Flag":
        other = self.lift(other)
        if self.high < other.low or self.low >= other.high:
            return Flag(self.writer, "", self.high < other.low)
        return self._compare("less", other)

    def __eq__(self, other: "Value | int") -> "Flag":  # type: ignore[override]
        other = self.lift(other)
        if self.high < other.low or self.low > other.high:
            return Flag(self.writer, "", False)
        if self.low == self.high == other.low == other.high:
            return Flag(self.writer, "", True)
        return self._compare("equal", other)

    def __ne__(self, other: "Value | int") -> "Flag":  # type: ignore[override]
        return (self == other).negated()

    def differs(self, other: "Value") -> "Flag":
        """Whether two values differ, as a loose flag where that is less to compute."""
        if max(self.kind, other.kind) > Kind.INT32 or self.high < other.low or other.high < self.low:
            return self != other
        text = f"xor_{FLAG}({self.at(Kind.INT32)}, {other.at(Kind.INT32)})"
        return Flag(self.writer, self.writer.bind(FLAG, text), loose=True)

    def _compare(self, name: str, other: "Value") -> "Flag":
        kind = max(self.kind, other.kind)
        return self.writer.flag(f"{name}_{kind.c_type}({self.at(kind)}, {other.at(kind)})")


@dataclass(frozen=True, slots=True)
class Term:
    """A part of a sum: a value times a power of two."""

    value: Value
    shift: int
    is_negative: bool = False


# A right shift looks through sums of so many terms.
_TERMS = 8


def _summed(terms: Sequence[Term], down: int) -> tuple[Value, Kind]:
    """The sum of terms, with shifts less by ``down``, and the widest type that it takes."""
    total = terms[0].value.lift(0)
    widest = Kind.INT32
    for term in terms:
        part = term.value << (term.shift - down)
        total = total - part if term.is_negative else total + part
        widest = max(widest, part.kind, total.kind)
    return total, widest


def _shifted_by_terms(value: Value, count: int) -> Value | None:
    """A right shift of a sum by shifts of its terms, where that takes a narrower type than the sum.

    Terms that end above the bits that are dropped have no part in the floor.
    """
    above = [term for term in value.terms if term.shift >= count]
    below = [term for term in value.terms if term.shift < count]
    least = min((term.shift for term in below), default=0)
    if not below or not (above or least):
        return None
    low, widest = _summed(below, least)
    high, other = _summed(above, count) if above else (value.lift(0), Kind.INT32)
    total = high + (low >> (count - least))
    if max(widest, other, total.kind) >= value.kind:
        return None
    return total.known(value.low >> count, value.high >> count)


@dataclass(frozen=True, slots=True)
class Flag:
    """A C integer that is -1 (true) or 0, or a truth ``known`` when the C is written.

    A ``loose`` one may be any integer where it is true. It takes one instruction less to compute, and many
    that are joined are made strict only once.
    """

    writer: Writer
    text: str
    known: bool | None = None
    loose: bool = False

    @property
    def c(self) -> str:
        """The flag as a C expression of -1 or 0."""
        if self.known is not None:
            return literal_text(-int(self.known), Kind.INT32)
        return self.negated().negated().text if self.loose else self.text

    @property
    def nonzero(self) -> str:
        """The flag as a C expression that is not 0 where it holds."""
        return self.c if self.known is not None else self.text

    def __and__(self, other: "Flag") -> "Flag":
        for one, another in ((self, other), (other, self)):
            if one.known is not None:
                return another if one.known else one
        loose = self.loose != other.loose
        a, b = (flag.text if loose else flag.c for flag in (self, other))
        return Flag(self.writer, self.writer.bind(FLAG, f"{a} & {b}"), loose=loose)

    def __or__(self, other: "Flag") -> "Flag":
        for one, another in ((self, other), (other, self)):
            if one.known is not None:
                return one if one.known else another
        text = self.writer.bind(FLAG, f"{self.text} | {other.text}")
        return Flag(self.writer, text, loose=self.loose or other.loose)

    @property
    def number(self) -> Value:
        """One where the flag holds, else zero."""
        return 0 - -self

    def negated(self) -> "Flag":
        """The opposite flag."""
        if self.known is not None:
            return Flag(self.writer, "", not self.known)
        if self.loose:
            return self.writer.flag(f"equal_{FLAG}({self.text}, {literal_text(0, Kind.INT32)})")
        return self.writer.flag(f"~{self.text}")

    def __neg__(self) -> Value:
        """Minus one where the flag holds, else zero."""
        if self.known is not None:
            return self.writer.literal(-int(self.known))
        return self.writer.value(self.c, Kind.INT32, -1, 0)


def choose(condition: Flag, if_true: Value | int, if_false: Value | int) -> Value:
    """``if_true`` where the condition holds, else ``if_false``."""
    writer = condition.writer
    a, b = (writer.literal(v) if isinstance(v, int) else v for v in (if_true, if_false))
    if condition.known is not None:
        return a if condition.known else b
    low, high = min(a.low, b.low), max(a.high, b.high)
    kind = writer.kind(low, high)
    text = f"select_{kind.c_type}({condition.c}, {a.at(kind)}, {b.at(kind)})"
    return writer.value(text, kind, low, high)


# Rows are looked up in pieces of so many bits, so that each fits a lane whatever the width of the row.
_PIECE = 31


def row_of(rows: Sequence[int], index: Value) -> Value:
    """The row at an index from 0; an index beyond the last row gives the last one."""
    low, high = min(rows), max(rows)
    if signed_bits(low, high) > Kind.INT32:
        upper = row_of([row >> _PIECE for row in rows], index)
        lower = row_of([row & (1 << _PIECE) - 1 for row in rows], index)
        return ((upper << _PIECE) + lower).known(low, high)
    last = len(rows) - 1
    writer, place = index.writer, index.clamped(0, last).forced(0, last)
    text = f"look_up({writer.table(tuple(rows))}, {place.at(Kind.INT32)})"
    return writer.value(text, Kind.INT32, low, high)
