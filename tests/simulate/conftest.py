"""Typed graphs made by hand: a small builder, and the radar filter that the engine is measured with."""

from dataclasses import dataclass, field
from fractions import Fraction

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.graph.operations import (
    Add,
    And,
    Bits,
    Constant,
    Divide,
    Flag,
    Graph,
    Input,
    Multiply,
    Negative,
    Not,
    Operation,
    Or,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    StateFlag,
    Subtract,
    Table,
)
from kalmanhdl.numerics.interval import type_of
from kalmanhdl.numerics.typed import Interval, TypedGraph


@dataclass
class Builder:
    """Adds operations, and finds for each exact one the format that holds its interval."""

    division: DivisionMethod = field(default_factory=LongDivision)
    rounding: Rounding = Rounding.HALF_EVEN
    operations: list[Operation] = field(default_factory=list)
    formats: list[Fixed | None] = field(default_factory=list)
    intervals: list[Interval | None] = field(default_factory=list)
    states: dict[str, int] = field(default_factory=dict)
    outputs: dict[str, int] = field(default_factory=dict)

    def _add(self, operation: Operation, form: Fixed | None = None, interval: Interval | None = None) -> int:
        if form is not None and interval is None:
            interval = Interval(low=form.lowest, high=form.highest)
        self.operations.append(operation)
        self.formats.append(form)
        self.intervals.append(interval)
        return len(self.operations) - 1

    def _exact(self, operation: Operation, fraction: int, *bounds: int) -> int:
        low, high = min(bounds), max(bounds)
        signed = low < 0
        width = max(1, low.bit_length() if low >= 0 else (~low).bit_length(), high.bit_length()) + signed
        form = Fixed(width=width, fraction=fraction, signed=signed)
        return self._add(operation, form, Interval(low=low, high=high))

    def bounds(self, k: int, fraction: int) -> tuple[int, int]:
        shift = fraction - self.formats[k].fraction
        return self.intervals[k].low << shift, self.intervals[k].high << shift

    def input(self, name: str, form: Fixed) -> int:
        return self._add(Input(name), form)

    def state(self, name: str, form: Fixed) -> int:
        return self._add(State(name), form)

    def flag(self, name: str) -> int:
        return self._add(Flag(name))

    def state_flag(self, name: str) -> int:
        return self._add(StateFlag(name))

    def constant(self, value: float | Fraction, fraction: int) -> int:
        raw = Fraction(value) * Fraction(2) ** fraction
        assert raw.denominator == 1
        return self._exact(Constant(Fraction(value)), fraction, int(raw))

    def _fraction(self, a: int, b: int) -> int:
        return max(self.formats[a].fraction, self.formats[b].fraction)

    def add(self, a: int, b: int) -> int:
        fraction = self._fraction(a, b)
        (al, ah), (bl, bh) = self.bounds(a, fraction), self.bounds(b, fraction)
        return self._exact(Add(a, b), fraction, al + bl, ah + bh)

    def subtract(self, a: int, b: int) -> int:
        fraction = self._fraction(a, b)
        (al, ah), (bl, bh) = self.bounds(a, fraction), self.bounds(b, fraction)
        return self._exact(Subtract(a, b), fraction, al - bh, ah - bl)

    def multiply(self, a: int, b: int) -> int:
        i, j = self.intervals[a], self.intervals[b]
        fraction = self.formats[a].fraction + self.formats[b].fraction
        return self._exact(
            Multiply(a, b), fraction, *(x * y for x in (i.low, i.high) for y in (j.low, j.high))
        )

    def shift(self, a: int, exponent: int) -> int:
        form, interval = self.formats[a], self.intervals[a]
        moved = Fixed(width=form.width, fraction=form.fraction - exponent, signed=form.signed)
        return self._add(Shift(a, exponent), moved, interval)

    def select(self, flag: int, a: int, b: int) -> int:
        fraction = self._fraction(a, b)
        return self._exact(Select(flag, a, b), fraction, *self.bounds(a, fraction), *self.bounds(b, fraction))

    def quantise(
        self,
        a: int,
        form: Fixed,
        rounding: Rounding = Rounding.HALF_EVEN,
        overflow: Overflow = Overflow.SATURATE,
    ) -> int:
        return self._add(Quantise(a, form, rounding, overflow), form)

    def bits(self, a: int, form: Fixed) -> int:
        return self._add(Bits(a, form), form)

    def table(self, a: int, rows: tuple[int, ...], fraction: int) -> int:
        scaled = tuple(Fraction(row) / Fraction(2) ** fraction for row in rows)
        form, interval = type_of(Table(0, scaled), [self._type(a)], None)
        return self._add(Table(a, scaled), form, interval)

    def negative(self, a: int) -> int:
        return self._add(Negative(a))

    def _type(self, k: int) -> tuple[Fixed, Interval]:
        return self.formats[k], self.intervals[k]

    def reciprocal(self, a: int, form: Fixed) -> int:
        return self._add(Reciprocal(a), form)

    def divide(self, a: int, b: int, form: Fixed) -> int:
        return self._add(Divide(a, b), form)

    def outside(self, a: int, form: Fixed, rounding: Rounding = Rounding.HALF_EVEN) -> int:
        return self._add(Outside(a, form, rounding))

    def both(self, a: int, b: int) -> int:
        return self._add(And(a, b))

    def either(self, a: int, b: int) -> int:
        return self._add(Or(a, b))

    def negate(self, a: int) -> int:
        return self._add(Not(a))

    def typed(self) -> TypedGraph:
        origins = tuple(f"test: {k}" for k in range(len(self.operations)))
        graph = Graph(
            tuple(self.operations), origins, tuple(self.states.items()), tuple(self.outputs.items())
        )
        return TypedGraph(
            graph, tuple(self.formats), tuple(self.intervals), self.division, self.rounding, (), {}
        )


def radar(width: int = 16, division: DivisionMethod | None = None) -> TypedGraph:
    """Two axes of a constant velocity filter, normalised: T = 1, R = 1/4, x in +-4, P in 0..2."""
    b = Builder(division or LongDivision(), Rounding.HALF_UP)
    initialise, sticky = b.flag("initialise"), b.state_flag("saturated")
    for axis in range(2):
        sticky = _axis(b, axis, width, initialise, sticky)
    b.states["saturated"] = sticky
    return b.typed()


def _axis(b: Builder, axis: int, width: int, initialise: int, sticky: int) -> int:
    state = Fixed(width=width, fraction=width - 3)
    variance = Fixed(width=width, fraction=width - 1, signed=False)
    unit = Fixed(width=width, fraction=width, signed=False)
    i, j = 2 * axis, 2 * axis + 1
    z = b.input(f"z[{axis}]", state)
    x1, x2 = (b.state(f"x[{k}]", state) for k in (i, j))
    names = f"P[{i},{i}]", f"P[{i},{j}]", f"P[{j},{j}]"
    p11, p12, p22 = (b.state(name, variance) for name in names)
    noise, q = b.constant(0.25, width), b.constant(Fraction(1, 64), width - 1)

    def fit(value: int, form: Fixed) -> int:
        nonlocal sticky
        sticky = b.either(sticky, b.outside(value, form, Rounding.HALF_UP))
        return b.quantise(value, form, Rounding.HALF_UP)

    p12p = fit(b.add(p12, p22), variance)
    p11p = fit(b.add(b.add(p11, p12), p12p), variance)
    p22p = fit(b.add(p22, q), variance)
    x1p = fit(b.add(x1, x2), state)
    s = b.add(p11p, noise)
    r = b.reciprocal(s, Fixed(width=width, fraction=width - 3, signed=False))
    rho = fit(b.multiply(noise, r), unit)
    k1 = fit(b.subtract(b.constant(1, width), rho), unit)
    k2 = fit(b.multiply(p12p, r), unit)
    y = fit(b.subtract(z, x1p), state)
    new = {
        f"x[{i}]": fit(b.add(x1p, fit(b.multiply(k1, y), state)), state),
        f"x[{j}]": fit(b.add(x2, fit(b.multiply(k2, y), state)), state),
        names[0]: fit(b.multiply(k1, noise), variance),
        names[1]: fit(b.multiply(k2, noise), variance),
        names[2]: fit(b.subtract(p22p, fit(b.multiply(k2, p12p), variance)), variance),
    }
    zero, start = b.constant(0, 0), b.constant(0.5, variance.fraction)
    first = dict(zip(new, (z, zero, noise, zero, start), strict=True))
    for name, value in new.items():
        form = variance if name[0] == "P" else state
        b.states[name] = b.quantise(b.select(initialise, first[name], value), form, Rounding.HALF_UP)
        if name[0] == "x":
            b.outputs[name] = b.states[name]
    return sticky
