"""What functions are built of: exact operations, and bits taken on purpose."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor

from kalmanhdl.arithmetic.fixed import Fixed, Rounding, rounded, wrapped
from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.operations import Bits, Negative, Table
from kalmanhdl.numerics.interval import Typed, smallest
from kalmanhdl.numerics.signed_digits import multiplied
from kalmanhdl.numerics.typed import Interval


@dataclass(frozen=True, slots=True)
class Circuit:
    """A graph of integers under construction; ``type_of`` gives format and interval of an operation.

    ``known`` collects intervals of which more is known than operands tell; ``type_of`` heeds them.
    """

    builder: Builder
    type_of: Callable[[int], Typed]
    known: dict[int, Interval]

    def bounds(self, a: int) -> tuple[Fraction, Fraction]:
        """The least and the greatest value of a."""
        form, interval = self.type_of(a)
        return form.real(interval.low), form.real(interval.high)

    def fraction(self, a: int) -> int:
        """The fraction bits of a."""
        return self.type_of(a)[0].fraction

    def constant(self, value: int | Fraction) -> int:
        """A constant."""
        return self.builder.constant(Fraction(value))

    def add(self, a: int, b: int) -> int:
        """a + b."""
        x, y = self.builder.value(a), self.builder.value(b)
        return self.builder.add(a, b) if x is None or y is None else self.constant(x + y)

    def subtract(self, a: int, b: int) -> int:
        """a - b."""
        x, y = self.builder.value(a), self.builder.value(b)
        return self.builder.subtract(a, b) if x is None or y is None else self.constant(x - y)

    def shift(self, a: int, exponent: int) -> int:
        """a * 2**exponent."""
        return self.builder.shift(a, exponent)

    def times(self, factor: Fraction, a: int) -> int:
        """A binary fraction times a."""
        value = self.builder.value(a)
        return multiplied(self.builder, factor, a) if value is None else self.constant(factor * value)

    def where_negative(self, a: int, chosen: int, otherwise: int) -> int:
        """``chosen`` where a < 0."""
        low, high = self.bounds(a)
        if low >= 0 or high < 0:
            return otherwise if low >= 0 else chosen
        return self.builder.select(self.negative(a), chosen, otherwise)

    def negative(self, a: int) -> int:
        """The flag a < 0."""
        return self.builder.intern(Negative(a))

    def magnitude(self, a: int) -> int:
        """|a|."""
        low, high = self.bounds(a)
        magnitude = self.where_negative(a, self.subtract(self.constant(0), a), a)
        return self.within(magnitude, Fraction(0), max(abs(low), abs(high)))

    def clamped(self, a: int, low: Fraction, high: Fraction) -> int:
        """The nearest value from low to high; a itself where it never leaves them."""
        least, greatest = self.bounds(a)
        if greatest > high:
            limit = self.constant(high)
            a = self.where_negative(self.subtract(a, limit), a, limit)
        if least < low:
            limit = self.constant(low)
            a = self.where_negative(self.subtract(a, limit), limit, a)
        return self.within(a, max(least, low), min(greatest, high))

    def bits(self, a: int, form: Fixed) -> int:
        """The bits of a that a format has."""
        exact, interval = self.type_of(a)
        spare = max(form.fraction - exact.fraction, 0)
        if form.width <= spare:
            return self.constant(0)
        form = Fixed(width=form.width - spare, fraction=form.fraction - spare, signed=form.signed)
        dropped = exact.fraction - form.fraction
        value = self.builder.value(a)
        if value is not None:
            raw = rounded(int(value / exact.resolution), dropped, Rounding.FLOOR)
            return self.constant(form.real(wrapped(raw, form)))
        if not dropped and form.lowest <= interval.low and interval.high <= form.highest:
            return a
        return self.builder.intern(Bits(a, form))

    def floored(self, a: int, fraction: int) -> int:
        """a without the bits below a fraction."""
        low, high = self.bounds(a)
        return self.within(a, low, high, fraction)

    def within(self, a: int, low: Fraction, high: Fraction, fraction: int | None = None) -> int:
        """a with a format for values from low to high alone, which it is known never to leave."""
        exact = self.fraction(a)
        fraction = exact if fraction is None else min(fraction, exact)
        scale = Fraction(2) ** fraction
        interval = Interval(low=floor(low * scale), high=ceil(high * scale))
        form = smallest(interval.low, interval.high, fraction)
        made = self.bits(a, form)
        before = self.type_of(a)[1]
        if made == a and (before.low < interval.low or interval.high < before.high):
            made = self.builder.intern(Bits(a, form))
        if made != a and isinstance(self.builder.operations[made], Bits):
            self.known.setdefault(made, interval)
        return made

    def nearest(self, a: int, fraction: int) -> int:
        """a rounded to a fraction, ties up."""
        if self.fraction(a) <= fraction:
            return a
        half = self.constant(Fraction(2) ** -(fraction + 1))
        return self.floored(self.add(a, half), fraction)

    def row(self, a: int, rows: tuple[Fraction, ...]) -> int:
        """The row whose number is a; rows that are missing for numbers of its format are like the last."""
        number = self.builder.value(a)
        if number is not None or len(set(rows)) == 1:
            return self.constant(rows[int(number or 0)])
        missing = self.type_of(a)[1].high + 1 - len(rows)
        return self.builder.intern(Table(a, (*rows, *(rows[-1],) * missing)))
