"""Makes graphs: equal operations are one, constants fold, neutral and absorbing operands vanish."""

from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from typing import Any

from kalmanhdl.graph.functions import value_of
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Constant,
    Divide,
    Function,
    Graph,
    Multiply,
    Negative,
    Not,
    Operation,
    Or,
    Reciprocal,
    Select,
    Shift,
    Subtract,
    Table,
    Unary,
    operands,
)

_ZERO, _ONE = Fraction(0), Fraction(1)


class Builder:
    """Collects operations, each once; every method returns the index of the value asked for."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self.origins: list[str] = []
        self._index: dict[Operation, int] = {}

    @classmethod
    def of(cls, graph: Graph) -> "Builder":
        """A builder that begins with the operations of a graph, each at its own index."""
        builder = cls()
        builder.operations, builder.origins = list(graph.operations), list(graph.origins)
        for index, operation in enumerate(graph.operations):
            builder._index.setdefault(operation, index)
        return builder

    def intern(self, operation: Operation) -> int:
        """The index of an operation as it stands, made if it is new."""
        index = self._index.get(operation)
        if index is None:
            index = self._index[operation] = len(self.operations)
            self.operations.append(operation)
            self.origins.append("")
        return index

    def name(self, index: int, origin: str) -> None:
        """Give a value its origin; the first name given stays."""
        if not self.origins[index]:
            self.origins[index] = origin

    def constant(self, value: float | Fraction) -> int:
        """A constant. Folding stays in doubles, so that a value never grows without bound."""
        return self.intern(Constant(Fraction(value)))

    def number(self, value: float) -> int:
        """A number that an algorithm computes with."""
        return self.constant(value)

    def value(self, index: int) -> Fraction | None:
        """The value of a constant, None for anything else."""
        operation = self.operations[index]
        return operation.value if isinstance(operation, Constant) else None

    def _fold(self, value: Fraction) -> int:
        return self.constant(Fraction(float(value)))

    def _negated(self, index: int) -> int | None:
        """b where a value is 0 - b."""
        operation = self.operations[index]
        if isinstance(operation, Subtract) and self.value(operation.a) == _ZERO:
            return operation.b
        return None

    def add(self, a: int, b: int) -> int:
        """a + b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self._fold(x + y)
        if x == _ZERO or y == _ZERO:
            return b if x == _ZERO else a
        if a == b:
            return self.shift(a, 1)
        for positive, negative in ((a, self._negated(b)), (b, self._negated(a))):
            if negative is not None:
                return self.subtract(positive, negative)
        factored = self._common_factor(a, b)
        if factored is not None:
            factor, c, d = factored
            return self._scale(factor, self.add(c, d))
        return self.intern(Add(min(a, b), max(a, b)))

    def subtract(self, a: int, b: int) -> int:
        """a - b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self._fold(x - y)
        if a == b:
            return self.constant(_ZERO)
        if y == _ZERO:
            return a
        negative = self._negated(b)
        if negative is not None:
            return self.add(a, negative)
        factored = self._common_factor(a, b)
        if factored is not None:
            factor, c, d = factored
            return self._scale(factor, self.subtract(c, d))
        return self.intern(Subtract(a, b))

    def _common_factor(self, a: int, b: int) -> tuple[Fraction, int, int] | None:
        """f, c, d where a = f c and b = f d for a constant f that is not a mere shift."""
        p, q = self.operations[a], self.operations[b]
        if isinstance(p, Multiply) and isinstance(q, Multiply) and p.a == q.a:
            factor = self.value(p.a)
            return None if factor is None else (factor, p.b, q.b)
        return None

    def negate(self, a: int) -> int:
        """-a."""
        return self.subtract(self.constant(_ZERO), a)

    def multiply(self, a: int, b: int) -> int:
        """a * b; a constant that is a power of two becomes a shift."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self._fold(x * y)
        for negative, other in ((self._negated(a), b), (self._negated(b), a)):
            if negative is not None:
                return self.negate(self.multiply(negative, other))
        if x is not None:
            return self._scale(x, b)
        if y is not None:
            return self._scale(y, a)
        for complement, other in ((self._complement(a), b), (self._complement(b), a)):
            if complement is not None:
                return self.subtract(other, self.multiply(complement, other))
        return self.intern(Multiply(min(a, b), max(a, b)))

    def _complement(self, index: int) -> int | None:
        """c where a value is 1 - c: (1 - c) a = a - c a, whose product c a others may need as well."""
        operation = self.operations[index]
        if isinstance(operation, Subtract) and self.value(operation.a) == _ONE:
            return operation.b
        return None

    def _scale(self, factor: Fraction, a: int) -> int:
        if factor == _ZERO:
            return self.constant(_ZERO)
        if factor < 0:
            return self.negate(self._scale(-factor, a))
        operation = self.operations[a]
        if isinstance(operation, Shift):
            return self.shift(self._scale(factor, operation.a), operation.exponent)
        if isinstance(operation, Multiply) and (inner := self.value(operation.a)) is not None:
            return self._scale(Fraction(float(factor * inner)), operation.b)
        exponent = _power_of_two(factor)
        if exponent is not None:
            return self.shift(a, exponent)
        return self.intern(Multiply(self.constant(factor), a))

    def shift(self, a: int, exponent: int) -> int:
        """a * 2**exponent."""
        if exponent == 0:
            return a
        x = self.value(a)
        if x is not None:
            return self.constant(x * Fraction(2) ** exponent)
        operation = self.operations[a]
        if isinstance(operation, Shift):
            return self.shift(operation.a, operation.exponent + exponent)
        return self.intern(Shift(a, exponent))

    def divide(self, a: int, b: int) -> int:
        """a / b; by a constant it is a multiplication, of a constant a scaled reciprocal."""
        x, y = self.value(a), self.value(b)
        if y is not None:
            if y == _ZERO:
                raise ZeroDivisionError("division by a structural zero")
            return self._scale(Fraction(float(_ONE / y)), a)
        if x is not None:
            return self._scale(x, self.reciprocal(b))
        return self.intern(Divide(a, b))

    def reciprocal(self, a: int) -> int:
        """1 / a."""
        x = self.value(a)
        return self.intern(Reciprocal(a)) if x is None else self._fold(_ONE / x)

    def unary(self, function: Function, a: int) -> int:
        """A function of a."""
        x = self.value(a)
        if x is not None:
            return self.constant(float(value_of(function, float(x))))
        return self.intern(Unary(function, a))

    def binary(self, function: Function, a: int, b: int) -> int:
        """A function of a and b."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.constant(float(value_of(function, float(x), float(y))))
        if function is Function.HYPOTENUSE:
            a, b = min(a, b), max(a, b)
        return self.intern(Binary(function, a, b))

    def row(self, number: int, rows: Iterable[float]) -> int:
        """The row of a number that is whole."""
        return self.intern(Table(number, tuple(map(Fraction, rows))))

    def select(self, flag: int, a: int, b: int) -> int:
        """a where the flag holds, else b."""
        chosen, otherwise = self.operations[a], self.operations[b]
        if isinstance(chosen, Select) and chosen.flag == flag:
            return self.select(flag, chosen.a, b)
        if isinstance(otherwise, Select) and otherwise.flag == flag:
            return self.select(flag, a, otherwise.b)
        return a if a == b else self.intern(Select(flag, a, b))

    def negative(self, a: int) -> int:
        """The flag a < 0."""
        return self.intern(Negative(a))

    def both(self, a: int, b: int) -> int:
        """The flag a and b."""
        return a if a == b else self.intern(And(min(a, b), max(a, b)))

    def either(self, a: int, b: int) -> int:
        """The flag a or b."""
        return a if a == b else self.intern(Or(min(a, b), max(a, b)))

    def opposite(self, a: int) -> int:
        """The flag not a."""
        operation = self.operations[a]
        return operation.a if isinstance(operation, Not) else self.intern(Not(a))

    def rebuild(self, operation: Operation, moved: dict[int, int]) -> int:
        """An operation of another graph on operands that have moved here, simplified."""
        ins = tuple(moved[i] for i in operands(operation))
        match operation:
            case Add():
                return self.add(*ins)
            case Subtract():
                return self.subtract(*ins)
            case Multiply():
                return self.multiply(*ins)
            case Divide():
                return self.divide(*ins)
            case Reciprocal():
                return self.reciprocal(*ins)
            case Unary(function=function):
                return self.unary(function, *ins)
            case Binary(function=function):
                return self.binary(function, *ins)
            case Select():
                return self.select(*ins)
            case Shift(exponent=exponent):
                return self.shift(ins[0], exponent)
            case And():
                return self.both(*ins)
            case Or():
                return self.either(*ins)
            case Not():
                return self.opposite(*ins)
            case _:
                return self.intern(with_operands(operation, ins))

    def graph(self, states: Iterable[tuple[str, int]], outputs: Iterable[tuple[str, int]]) -> Graph:
        """The graph of what states and outputs need, in topological order; the rest is dropped."""
        states, outputs = tuple(states), tuple(outputs)
        kept = sorted(reachable(self.operations, [index for _, index in (*states, *outputs)]))
        place = {old: new for new, old in enumerate(kept)}
        return Graph(
            operations=tuple(
                with_operands(self.operations[k], tuple(place[i] for i in operands(self.operations[k])))
                for k in kept
            ),
            origins=tuple(self.origins[k] for k in kept),
            states=tuple((name, place[index]) for name, index in states),
            outputs=tuple((name, place[index]) for name, index in outputs),
        )


def reachable(operations: list[Operation] | tuple[Operation, ...], roots: Iterable[int]) -> set[int]:
    """The indices that the roots need, themselves included."""
    seen: set[int] = set()
    stack = list(roots)
    while stack:
        index = stack.pop()
        if index not in seen:
            seen.add(index)
            stack.extend(operands(operations[index]))
    return seen


def with_operands(operation: Operation, ins: tuple[int, ...]) -> Operation:
    """The operation on other operands, in the order of its fields."""
    names = [name for name in ("flag", "a", "b") if hasattr(operation, name)]
    moved: dict[str, Any] = dict(zip(names, ins, strict=True))
    return replace(operation, **moved) if moved else operation


def _power_of_two(value: Fraction) -> int | None:
    """The exponent of a positive power of two, None for anything else."""
    if value.numerator & (value.numerator - 1) or value.denominator & (value.denominator - 1):
        return None
    return value.numerator.bit_length() - value.denominator.bit_length()
