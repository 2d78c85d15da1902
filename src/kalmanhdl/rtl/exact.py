"""The exact operations as Amaranth expressions: they grow, and lose nothing."""

from dataclasses import dataclass

from amaranth.hdl import Cat, Const, Mux, Value

from kalmanhdl.arithmetic.fixed import Fixed, stands_below
from kalmanhdl.rtl.shapes import fitted


@dataclass(frozen=True)
class Number:
    """A raw integer in hardware with its format."""

    raw: Value
    form: Fixed

    def at_fraction(self, fraction: int) -> Value:
        """The raw integer with more fraction bits."""
        return self.raw.shift_left(fraction - self.form.fraction)


def add(a: Number, b: Number, fraction: int) -> Value:
    """a + b with so many fraction bits."""
    for upper, lower in ((a, b), (b, a)):
        if stands_below(lower.form, upper.form):
            bits = fraction - upper.form.fraction
            joined = Cat(fitted(lower.raw, bits, False), upper.raw)
            return joined.as_signed() if upper.form.signed else joined
    return a.at_fraction(fraction) + b.at_fraction(fraction)


def subtract(a: Number, b: Number, fraction: int) -> Value:
    """a - b with so many fraction bits."""
    return a.at_fraction(fraction) - b.at_fraction(fraction)


def select(flag: Value, a: Number, b: Number, fraction: int) -> Value:
    """a where the flag holds, else b, with so many fraction bits."""
    return Mux(flag, a.at_fraction(fraction), b.at_fraction(fraction))


def negative(a: Number) -> Value:
    """Whether a < 0."""
    return a.raw[-1] if a.form.signed else Const(0, 1)
