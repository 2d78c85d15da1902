"""Functions of floating-point numbers as operations on such numbers, each rounded once.

Of all functions the graph keeps the square root, which is rounded once, and ``wrap``, which is exact.
Arguments are reduced without error, then polynomials of Taylor's series follow, of the degree that the
mantissa needs, in Estrin's order: products that do not wait for each other. Errors are in
``docs/floating_point.md``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from math import factorial
from typing import assert_never

from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.builder import Builder, with_operands
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Constant,
    Divide,
    Function,
    Graph,
    Multiply,
    Negative,
    Operation,
    Select,
    Shift,
    Subtract,
    Table,
    Unary,
    operands,
)
from kalmanhdl.graph.simplify import TERM
from kalmanhdl.numerics.functions.constants import angle_of, log2_e, log_2, pi

# Of one rounding each.
KEPT = (Function.SQUARE_ROOT, Function.WRAP)
# Arguments of the polynomials end here: half a quarter of a turn, half the logarithm of two, half an eighth.
_EIGHTH_TURN, _HALF_OCTAVE, _SIXTEENTH = Fraction(1, 2), Fraction(7, 20), Fraction(1, 16)


def without_functions(graph: Graph, form: Float) -> tuple[Graph, tuple[int, ...]]:
    """The graph with its functions as operations of a format, and where each of its operations is there."""
    builder, moved = Builder(), list[int]()
    for index, operation in enumerate(graph.operations):
        before, ins = len(builder.operations), tuple(moved[k] for k in operands(operation))
        if isinstance(operation, Unary | Binary) and operation.function not in KEPT:
            moved.append(_Circuit(builder, form).function(operation.function, ins))
        else:
            moved.append(builder.intern(with_operands(operation, ins)))
        _name(builder, before, moved[index], graph.origins[index])
    states = tuple((name, moved[root]) for name, root in graph.states)
    outputs = tuple((name, moved[root]) for name, root in graph.outputs)
    made = Graph(tuple(builder.operations), tuple(builder.origins), states, outputs)
    return made, tuple(moved)


def _name(builder: Builder, before: int, last: int, origin: str) -> None:
    builder.name(last, origin)
    term = origin if origin.endswith(TERM) else origin + TERM
    for index in range(before, len(builder.operations)):
        if not isinstance(builder.operations[index], Constant):
            builder.name(index, term)


@dataclass(frozen=True, slots=True)
class _Circuit:
    """Operations of one format under construction. Methods take and return indices."""

    builder: Builder
    form: Float

    @property
    def bits(self) -> int:
        """Of the numbers from which constants are rounded."""
        return self.form.mantissa + self.form.exponent + 8

    def make(self, operation: Operation) -> int:
        """An operation."""
        return self.builder.intern(operation)

    def rounded(self, value: Fraction | int) -> Fraction:
        """The nearest number of the format; the greatest for what is beyond all numbers."""
        raw = self.form.nearest(Fraction(value))
        beyond = self.form.is_infinite(raw)
        return self.form.real(self.form.highest | raw & self.form.sign if beyond else raw)

    def number(self, value: Fraction | int) -> int:
        """A constant, rounded."""
        return self.make(Constant(self.rounded(value)))

    def add(self, a: int, b: int) -> int:
        """a + b."""
        return self.make(Add(a, b))

    def subtract(self, a: int, b: int) -> int:
        """a - b."""
        return self.make(Subtract(a, b))

    def multiply(self, a: int, b: int) -> int:
        """a * b."""
        return self.make(Multiply(a, b))

    def row(self, number: int, rows: Sequence[Fraction | int]) -> int:
        """The row of a number, rounded."""
        values = tuple(map(self.rounded, rows))
        return self.make(Constant(values[0]) if len(values) == 1 else Table(number, values))

    def where_negative(self, a: int, chosen: int, otherwise: int) -> int:
        """``chosen`` where a < 0."""
        return self.make(Select(self.make(Negative(a)), chosen, otherwise))

    def wrapped(self, a: int) -> int:
        """a less the nearest whole number."""
        return self.make(Unary(Function.WRAP, a))

    def polynomial(self, coefficients: Sequence[Fraction], x: int) -> int:
        """The sum of coefficients times powers of x, from the constant up; neighbours are joined first."""
        terms = [self.number(each) for each in coefficients]
        while len(terms) > 1:
            pairs = zip(terms[::2], terms[1::2], strict=False)
            joined = [self.add(low, self.multiply(high, x)) for low, high in pairs]
            terms = joined + terms[2 * len(joined) :]
            if len(terms) > 1:
                x = self.multiply(x, x)
        return terms[0]

    def function(self, function: Function, ins: tuple[int, ...]) -> int:
        """The value of a function."""
        match function:
            case Function.SINE:
                return self._of_angle(ins[0], 0)
            case Function.COSINE:
                return self._of_angle(ins[0], 1)
            case Function.EXPONENTIAL:
                return self._exponential(ins[0])
            case Function.ARCTANGENT:
                return self._arctangent(*ins)
            case Function.HYPOTENUSE:
                return self._hypotenuse(*ins)
            case Function.SQUARE_ROOT | Function.WRAP:
                raise AssertionError(f"{function} is an operation itself")
            case _:
                assert_never(function)

    def _series(self, reach: Fraction, power: int, coefficient: Callable[[int], Fraction]) -> list[Fraction]:
        """The coefficients of a series in x**power, x up to ``reach``, until they are of no account."""
        found = []
        for k in count():
            found.append(coefficient(k))
            if abs(coefficient(k + 1)) * reach ** (power * (k + 2)) < Fraction(1, 4 << self.form.mantissa):
                return found
        raise AssertionError

    def _of_angle(self, turns: int, quarters: int) -> int:
        """The sine of an angle and so many quarters of a turn.

        The nearest whole quarter decides which of sine and cosine of the rest it is, and its sign; both are
        found without error. The polynomials are those of the rest in quarters of a turn.
        """
        rest = self.wrapped(self.make(Shift(turns, 2)))
        number = self.subtract(self.make(Shift(self.wrapped(turns), 2)), rest)
        number = self.add(number, self.number(2))
        which = [(quarter + quarters) % 4 for quarter in range(-2, 3)]
        sign = self.row(number, [-1 if each >= 2 else 1 for each in which])
        is_even = self.row(number, [-1 if each % 2 else 1 for each in which])
        square = self.multiply(rest, rest)
        signed = self.multiply(sign, rest)
        sine, cosine = (self._quarter_series(power) for power in (3, 2))
        first = self.where_negative(is_even, sign, self.multiply(signed, self.number(pi(self.bits) / 2)))
        less = self.where_negative(is_even, self.multiply(sign, square), self.multiply(signed, square))
        factor = self.where_negative(is_even, self.polynomial(cosine, square), self.polynomial(sine, square))
        return self.add(first, self.multiply(less, factor))

    def _quarter_series(self, first: int) -> list[Fraction]:
        """The coefficients of sine or cosine, of every other power of an angle in quarters of a turn."""
        quarter = pi(self.bits) / 2

        def coefficient(k: int) -> Fraction:
            power = 2 * k + first
            return Fraction((-1) ** (k + 1), factorial(power)) * Fraction(quarter**power)

        return self._series(_EIGHTH_TURN, 2, coefficient)

    def _exponential(self, x: int) -> int:
        """2**whole times the exponential of the rest; whole by the head of the logarithm of 2 is exact."""
        form = self.form
        least, greatest = -2 * ((form.bias + form.mantissa + 3) // 2), form.bias + 2
        for limit, sign in ((greatest, 1), (least, -1)):
            end = self.number(limit * log_2(self.bits))
            beyond = self.subtract(end, x) if sign > 0 else self.subtract(x, end)
            x = self.where_negative(beyond, end, x)
        binary = self.multiply(x, self.number(log2_e(self.bits)))
        whole = self.subtract(binary, self.wrapped(binary))
        bits = max(form.mantissa + 1 - (greatest - least).bit_length(), 1)
        head = Fraction(int(log_2(self.bits) * (1 << bits)), 1 << bits)
        rest = self.subtract(x, self.multiply(whole, self.number(head)))
        rest = self.subtract(rest, self.multiply(whole, self.number(log_2(self.bits) - head)))
        tail = self._series(_HALF_OCTAVE, 1, lambda k: Fraction(1, factorial(k + 2)))
        square = self.multiply(rest, rest)
        power = self.add(self.number(1), self.add(rest, self.multiply(square, self.polynomial(tail, rest))))
        return self._times_power_of_two(power, whole, least, greatest)

    def _times_power_of_two(self, a: int, exponent: int, least: int, greatest: int) -> int:
        """a * 2**exponent, for a whole exponent: times the power within an octave of octaves, then its rest.

        The latter comes in two factors, of which none leaves the format before the product does.
        """
        level = max(min((greatest - least).bit_length() // 2, self.form.bias.bit_length() - 1), 0)
        bases = range(least, greatest + 1, 1 << level)
        number = self.add(exponent, self.number(-least))
        number = self.make(Shift(number, -level)) if level else number
        above = self.subtract(exponent, self.row(number, bases))
        a = self.multiply(a, self.row(above, [Fraction(2) ** k for k in range(1 << level)]))
        for halves in ([base // 2 for base in bases], [base - base // 2 for base in bases]):
            a = self.multiply(a, self.row(number, [Fraction(2) ** half for half in halves]))
        return a

    def _magnitude(self, a: int) -> int:
        return self.where_negative(a, self.subtract(self.number(0), a), a)

    def _slope(self, a: int, b: int) -> tuple[int, int, int]:
        """The smaller magnitude by the larger one, that one, and what is negative where a is larger."""
        a, b = self._magnitude(a), self._magnitude(b)
        swapped = self.subtract(b, a)
        low, high = self.where_negative(swapped, b, a), self.where_negative(swapped, a, b)
        # Where both are zero the slope is zero.
        divisor = self.where_negative(self.subtract(self.number(0), high), high, self.number(1))
        return self.make(Divide(low, divisor)), high, swapped

    def _arctangent(self, height: int, right: int) -> int:
        """The angle of the nearest eighth of a slope, and that of the slope between them."""
        slope, _, swapped = self._slope(height, right)
        eighths = self.make(Shift(slope, 3))
        eighth = self.subtract(eighths, self.wrapped(eighths))
        near = self.make(Shift(eighth, -3))
        across = self.add(self.number(1), self.multiply(slope, near))
        d = self.make(Divide(self.subtract(slope, near), across))
        square = self.multiply(d, d)
        series = self._series(_SIXTEENTH, 2, lambda k: Fraction((-1) ** (k + 1), 2 * k + 3))
        small = self.multiply(self.multiply(d, square), self.polynomial(series, square))
        turns = self.multiply(self.add(d, small), self.number(1 / (2 * pi(self.bits))))
        rows = [angle_of(Fraction(k, 8), self.bits) for k in range(9)]
        angle = self.add(self.row(eighth, rows), turns)
        angle = self.where_negative(swapped, self.subtract(self.number(Fraction(1, 4)), angle), angle)
        angle = self.where_negative(right, self.subtract(self.number(Fraction(1, 2)), angle), angle)
        return self.where_negative(height, self.subtract(self.number(0), angle), angle)

    def _hypotenuse(self, a: int, b: int) -> int:
        """The larger magnitude times the root of one and the square of the slope."""
        slope, high, _ = self._slope(a, b)
        square = self.add(self.number(1), self.multiply(slope, slope))
        return self.multiply(high, self.make(Unary(Function.SQUARE_ROOT, square)))
