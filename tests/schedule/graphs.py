"""Typed graphs for tests: a small builder, random ones, and a filter loop written by hand."""

from dataclasses import replace
from fractions import Fraction

from hypothesis import strategies as st

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton, reciprocal
from kalmanhdl.arithmetic.division_structure import bits_of
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, quantise
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
from kalmanhdl.numerics.typed import Interval, TypedGraph, Violation


class Builder:
    """Appends operations and gives them the format of their exact value."""

    def __init__(self, division: DivisionMethod = LongDivision()) -> None:  # noqa: B008
        self.division = division
        self.operations: list[Operation] = []
        self.formats: list[Fixed | None] = []
        self.intervals: list[Interval | None] = []

    def source(self, operation: Input | State, form: Fixed) -> int:
        return self._append(operation, form, form.lowest, form.highest)

    def flag(self, operation: Operation) -> int:
        self.operations.append(operation)
        self.formats.append(None)
        self.intervals.append(None)
        return len(self.operations) - 1

    def constant(self, raw: int, fraction: int) -> int:
        operation = Constant(Fraction(raw) / Fraction(2) ** fraction)
        return self._append(operation, self._tight(raw, raw, fraction), raw, raw)

    def sum(self, kind: type[Add] | type[Subtract], a: int, b: int) -> int:
        fraction = max(self._form(a).fraction, self._form(b).fraction)
        (a0, a1), (b0, b1) = self._at(a, fraction), self._at(b, fraction)
        low, high = (a0 + b0, a1 + b1) if kind is Add else (a0 - b1, a1 - b0)
        return self._append(kind(a, b), self._tight(low, high, fraction), low, high)

    def multiply(self, a: int, b: int) -> int:
        fraction = self._form(a).fraction + self._form(b).fraction
        ends = [x * y for x in self._ends(a) for y in self._ends(b)]
        return self._append(Multiply(a, b), self._tight(min(ends), max(ends), fraction), min(ends), max(ends))

    def shift(self, a: int, exponent: int) -> int:
        form, (low, high) = self._form(a), self._ends(a)
        moved = Fixed(width=form.width, fraction=form.fraction - exponent, signed=form.signed)
        return self._append(Shift(a, exponent), moved, low, high)

    def select(self, flag: int, a: int, b: int) -> int:
        fraction = max(self._form(a).fraction, self._form(b).fraction)
        (a0, a1), (b0, b1) = self._at(a, fraction), self._at(b, fraction)
        low, high = min(a0, b0), max(a1, b1)
        return self._append(Select(flag, a, b), self._tight(low, high, fraction), low, high)

    def quantise(self, a: int, form: Fixed, rounding: Rounding, overflow: Overflow) -> int:
        ends = [quantise(x, self._form(a).fraction, form, rounding, Overflow.SATURATE) for x in self._ends(a)]
        low, high = ends[0][0], ends[1][0]
        if overflow is Overflow.WRAP and (ends[0][1] or ends[1][1]):
            low, high = form.lowest, form.highest
        return self._append(Quantise(a, form, rounding, overflow), form, low, high)

    def bits(self, a: int, form: Fixed) -> int:
        return self._append(Bits(a, form), form, form.lowest, form.highest)

    def table(self, a: int, rows: list[int], fraction: int) -> int:
        """The row that the lowest bits of a number name."""
        bits, count = Fixed(width=2, fraction=self._form(a).fraction, signed=False), Fraction(2) ** -fraction
        number = self.shift(self.bits(a, bits), bits.fraction)
        scaled = tuple(row * count for row in rows)
        form, interval = type_of(Table(0, scaled), [(self._form(number), Interval(low=0, high=3))], None)
        return self._append(Table(number, scaled), form, interval.low, interval.high)

    def reciprocal(self, a: int, form: Fixed) -> int:
        """The reciprocal of a variance: the divisor is made positive first."""
        divisor = self._positive(a)
        low, high = self._ends(divisor)
        ends = [
            reciprocal(x, self._form(divisor).fraction, form, Rounding.FLOOR, self.division)[0]
            for x in (high, low)
        ]
        return self._append(Reciprocal(divisor), form, max(0, ends[0] - 2), min(form.highest, ends[1] + 2))

    def divide(self, a: int, b: int, form: Fixed) -> int:
        return self._append(Divide(a, self._positive(b)), form, form.lowest, form.highest)

    def typed(self, states: dict[str, int], outputs: dict[str, int], rounding: Rounding) -> TypedGraph:
        origins = tuple(
            f"{type(o).__name__.lower()}: {k % 3},{k // 3}" for k, o in enumerate(self.operations)
        )
        graph = Graph(tuple(self.operations), origins, tuple(states.items()), tuple(outputs.items()))
        names = [*states, *outputs, *(o.name for o in self.operations if isinstance(o, Input))]
        return TypedGraph(
            graph,
            tuple(self.formats),
            tuple(self.intervals),
            self.division,
            rounding,
            self._violations(),
            {name: 2.0 ** (k % 5 - 2) for k, name in enumerate(names)},
        )

    def _violations(self) -> tuple[Violation, ...]:
        flags = [k for k, o in enumerate(self.operations) if isinstance(o, Outside)]
        quantised = [k for k, o in enumerate(self.operations) if isinstance(o, Quantise)]
        return tuple(
            Violation(quantise=q, outside=f, starting=bool(q % 2), running=bool(f % 2))
            for q, f in zip(quantised, flags, strict=False)
        )

    def _append(self, operation: Operation, form: Fixed, low: int, high: int) -> int:
        self.operations.append(operation)
        self.formats.append(form)
        self.intervals.append(Interval(low=low, high=high))
        return len(self.operations) - 1

    def _form(self, index: int) -> Fixed:
        form = self.formats[index]
        assert form is not None
        return form

    def _ends(self, index: int) -> tuple[int, int]:
        interval = self.intervals[index]
        assert interval is not None
        return interval.low, interval.high

    def _at(self, index: int, fraction: int) -> tuple[int, int]:
        low, high = self._ends(index)
        return low << (fraction - self._form(index).fraction), high << (fraction - self._form(index).fraction)

    def _positive(self, a: int) -> int:
        form = Fixed(width=self._form(a).width, fraction=self._form(a).fraction, signed=False)
        return self.quantise(a, form, Rounding.FLOOR, Overflow.SATURATE)

    @staticmethod
    def _tight(low: int, high: int, fraction: int) -> Fixed:
        return Fixed(width=bits_of(low, high), fraction=fraction, signed=low < 0)


formats = st.builds(Fixed, width=st.integers(2, 24), fraction=st.integers(-4, 20), signed=st.booleans())
methods = st.one_of(
    st.builds(LongDivision, radix=st.sampled_from((2, 4))),
    st.builds(TableNewton, index_bits=st.integers(2, 6), iterations=st.integers(0, 2)),
)


@st.composite
def typed_graphs(draw: st.DrawFn, largest: int = 24) -> TypedGraph:
    """Any typed graph: every class of operation, states that may or may not feed each other.

    States that are read are stored, as in every graph.
    """
    builder = Builder(draw(methods))
    names = [f"x[{k}]" for k in range(draw(st.integers(0, 4)))]
    state_forms = {name: draw(formats) for name in names}
    numbers = [builder.source(State(name), state_forms[name]) for name in names if draw(st.booleans())]
    numbers += [builder.source(Input(f"z[{k}]"), draw(formats)) for k in range(draw(st.integers(1, 3)))]
    numbers.append(builder.constant(draw(st.integers(-3000, 3000)), draw(st.integers(-2, 12))))
    flags = [builder.flag(Flag("initialise"))]
    if kept := draw(st.booleans()):
        flags.append(builder.flag(StateFlag("saturated")))
    for _ in range(draw(st.integers(0, largest))):
        _grow(draw, builder, numbers, flags)
    states = {
        name: builder.quantise(draw(st.sampled_from(numbers)), form, draw(st.sampled_from(Rounding)),
                               draw(st.sampled_from(Overflow)))
        for name, form in state_forms.items()
    }  # fmt: skip
    if kept or draw(st.booleans()):
        states["saturated"] = draw(st.sampled_from(flags))
    outputs = {f"y[{k}]": draw(st.sampled_from(numbers)) for k in range(draw(st.integers(0, 2)))}
    return builder.typed(states, outputs, draw(st.sampled_from(Rounding)))


def _grow(draw: st.DrawFn, builder: Builder, numbers: list[int], flags: list[int]) -> None:
    a, b = draw(st.sampled_from(numbers)), draw(st.sampled_from(numbers))
    flag, other = draw(st.sampled_from(flags)), draw(st.sampled_from(flags))
    form, rounding = draw(formats), draw(st.sampled_from(Rounding))
    wide = max(bits_of(*builder._ends(k)) for k in (a, b))
    match draw(st.sampled_from("+-*<s?qq/rofnbtg")):
        case "+" | "-" as sign:
            numbers.append(builder.sum(Add if sign == "+" else Subtract, a, b))
        case "*" if wide < 60:
            numbers.append(builder.multiply(a, b))
        case "<":
            numbers.append(builder.shift(a, draw(st.integers(-3, 3))))
        case "s" | "?":
            numbers.append(builder.select(flag, a, b))
        case "q" | "*":
            numbers.append(builder.quantise(a, form, rounding, draw(st.sampled_from(Overflow))))
        case "/":
            numbers.append(builder.divide(a, b, form))
        case "r":
            numbers.append(builder.reciprocal(a, form))
        case "b":
            dropped = draw(st.integers(0, 4))
            part = replace(form, fraction=builder._form(a).fraction - dropped)
            numbers.append(builder.bits(a, part))
        case "t":
            rows = draw(st.lists(st.integers(-3000, 3000), min_size=4, max_size=6))
            numbers.append(builder.table(a, rows, draw(st.integers(-2, 9))))
        case "g":
            flags.append(builder.flag(Negative(a)))
        case "o":
            flags.append(builder.flag(Outside(a, form, rounding)))
        case "f":
            flags.append(builder.flag(draw(st.sampled_from((And, Or)))(flag, other)))
        case _:
            flags.append(builder.flag(Not(flag)))


WORD = Fixed(width=16, fraction=8)


def alpha_beta(division: DivisionMethod = LongDivision()) -> TypedGraph:  # noqa: B008
    """A scalar filter: the gain from a variance, the estimate from the gain, the square as an output."""
    b = Builder(division)
    x, variance, z = (b.source(State("x"), WORD), b.source(State("P"), WORD), b.source(Input("z"), WORD))
    noise = b.constant(77, 8)
    predicted = b.sum(Add, variance, noise)
    gain = b.reciprocal(predicted, Fixed(width=12, fraction=10))
    innovation = b.sum(Subtract, z, x)
    correction = b.multiply(gain, innovation)
    estimate = b.quantise(b.sum(Add, x, correction), WORD, Rounding.HALF_UP, Overflow.SATURATE)
    shrunk = b.quantise(b.multiply(gain, variance), WORD, Rounding.FLOOR, Overflow.SATURATE)
    square = b.multiply(innovation, innovation)
    return b.typed({"x": estimate, "P": shrunk}, {"x": estimate, "square": square}, Rounding.HALF_UP)
