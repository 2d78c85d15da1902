"""A typed graph for units that multiply and add: every quantised sum of products as one operation.

Sums, differences, products and moves of the binary point are exact, so that what is quantised may be written
out as a sum of products of numbers that a multiplier takes, in any order. A product that several sums use is
computed for each of them.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.graph.operations import (
    Add,
    Constant,
    Divide,
    Graph,
    Multiply,
    Operation,
    Outside,
    Product,
    Quantise,
    Reciprocal,
    Shift,
    Subtract,
    SumOfProducts,
    SumOutside,
    lags,
    operands,
)
from kalmanhdl.numerics.interval import constant_type, of_format
from kalmanhdl.numerics.signed_digits import FEW_DIGITS, canonical_signed_digits
from kalmanhdl.numerics.typed import Interval, TypedGraph

# Sums that would be longer stay sums.
_LONGEST = 32

# About how long those take before and after their products; this only orders the products.
_TURNS_OF_A_SUM, _TURNS_OF_A_QUOTIENT = 3, 8

# A product of no, one or two values.
_Factors = tuple[int, ...]
_Polynomial = Mapping[_Factors, Fraction]


def with_sums_of_products(typed: TypedGraph, widest: int) -> TypedGraph:
    """The same step with ``SumOfProducts`` where a quantised sum has products that are worth a multiplier.

    ``widest`` is the width, sign included, of the numbers that a multiplier takes.
    """
    return _Rewriting(typed, _sums(typed, widest), widest).graph()


@dataclass(frozen=True, slots=True)
class _Target:
    """What one quantisation, and the flag that belongs to it, make of an exact value."""

    exact: int
    form: Fixed
    rounding: Rounding


def _target(operation: Operation) -> _Target | None:
    match operation:
        case Quantise(a, form, rounding) | Outside(a, form, rounding):
            return _Target(a, form, rounding)
        case _:
            return None


def _sums(typed: TypedGraph, widest: int) -> dict[_Target, _Polynomial]:
    """The quantisations that become sums of products."""
    expansion, found = _Expansion(typed, widest), dict[_Target, _Polynomial]()
    for operation in typed.graph.operations:
        target = _target(operation)
        if target is None or target in found:
            continue
        polynomial = expansion.of(target.exact)
        if polynomial is not None and any(_is_product(*term) for term in polynomial.items()):
            found[target] = polynomial
    return found


def _is_product(factors: _Factors, factor: Fraction) -> bool:
    """Whether a term is worth a multiplier."""
    return len(factors) > 1 or len(canonical_signed_digits(factor.numerator)) > FEW_DIGITS


@dataclass(slots=True)
class _Expansion:
    """Exact values written out as sums of products of narrow values and constants."""

    typed: TypedGraph
    widest: int
    _known: dict[int, _Polynomial | None] = field(default_factory=dict)

    def of(self, index: int) -> _Polynomial | None:
        """The value, if it can be written out. What a value is made of is expanded before it."""
        for k in self._below(index):
            if k not in self._known:
                self._known[k] = self._expanded(k)
        return self._known[index]

    def _below(self, index: int) -> list[int]:
        """The exact operations that a value is made of, and the value itself, in their order."""
        operations, found, waiting = self.typed.graph.operations, {index}, [index]
        while waiting:
            operation = operations[waiting.pop()]
            if isinstance(operation, Add | Subtract | Multiply | Shift):
                fresh = [k for k in operands(operation) if k not in found and k not in self._known]
                found.update(fresh)
                waiting += fresh
        return sorted(found)

    def _expanded(self, index: int) -> _Polynomial | None:
        found = self._written_out(index)
        if found is not None and len(found) <= _LONGEST and all(map(self._fits, found.values())):
            return found
        return self._leaf(index)

    def _written_out(self, index: int) -> _Polynomial | None:
        match self.typed.graph.operations[index]:
            case Constant(value):
                return {(): value}
            case Shift(a, exponent):
                return _scaled(self._known[a], Fraction(2) ** exponent)
            case Add(a, b):
                return _sum(self._known[a], self._known[b])
            case Subtract(a, b):
                return _sum(self._known[a], _scaled(self._known[b], Fraction(-1)))
            case Multiply(a, b):
                return self._product(a, b)
            case _:
                return None

    def _product(self, a: int, b: int) -> _Polynomial | None:
        x, y = self._factor(a), self._factor(b)
        if x is None or y is None:
            constant, other = (x, b) if y is None else (y, a)
            if constant is None or constant[0]:
                return None
            return _scaled(self._known[other], constant[1])
        return {tuple(sorted((*x[0], *y[0]))): x[1] * y[1]}

    def _factor(self, index: int) -> tuple[_Factors, Fraction] | None:
        """A constant, or a narrow value whose binary point may be moved."""
        match self.typed.graph.operations[index]:
            case Constant(value):
                return (), value
            case Shift(a, exponent) if (moved := self._factor(a)) is not None:
                return moved[0], moved[1] * Fraction(2) ** exponent
            case _:
                return ((index,), Fraction(1)) if self._leaf(index) else None

    def _leaf(self, index: int) -> _Polynomial | None:
        form = self.typed.formats[index]
        narrow = form is not None and form.width + (not form.signed) <= self.widest
        return {(index,): Fraction(1)} if narrow else None

    def _fits(self, factor: Fraction) -> bool:
        """Whether a constant is one that a multiplier takes."""
        form, _ = constant_type(factor)
        return form.width + (not form.signed) <= self.widest


def _scaled(polynomial: _Polynomial | None, factor: Fraction) -> _Polynomial | None:
    if polynomial is None or not factor:
        return None if polynomial is None else {}
    return {factors: factor * value for factors, value in polynomial.items()}


def _sum(a: _Polynomial | None, b: _Polynomial | None) -> _Polynomial | None:
    if a is None or b is None:
        return None
    found = dict(a)
    for factors, value in b.items():
        found[factors] = found.get(factors, Fraction(0)) + value
    return {factors: value for factors, value in found.items() if value}


class _Rewriting:
    """The operations that are still needed, in their order, with sums of products among them."""

    def __init__(self, typed: TypedGraph, sums: Mapping[_Target, _Polynomial], widest: int) -> None:
        self._typed, self._sums, self._widest = typed, sums, widest
        self._operations: list[Operation] = []
        self._origins: list[str] = []
        self._formats: list[Fixed | None] = []
        self._intervals: list[Interval | None] = []
        self._depths: list[int] = []
        self._new: dict[int, int] = {}
        self._made: dict[tuple[_Target, Overflow], int] = {}
        self._constants: dict[tuple[Fraction, int], int] = {}
        quantised = (o for o in reversed(typed.graph.operations) if isinstance(o, Quantise))
        self._overflows = {_target(o): o.overflow for o in quantised}

    def graph(self) -> TypedGraph:
        """The whole graph."""
        old = self._typed.graph
        for index in self._needed():
            self._new[index] = self._moved(index, old.operations[index])
        return replace(
            self._typed,
            graph=Graph(
                operations=tuple(self._operations),
                origins=tuple(self._origins),
                states=tuple((name, self._new[root]) for name, root in old.states),
                outputs=tuple((name, self._new[root]) for name, root in old.outputs),
            ),
            formats=tuple(self._formats),
            intervals=tuple(self._intervals),
            violations=tuple(
                replace(v, quantise=self._new[v.quantise], outside=self._new[v.outside])
                for v in self._typed.violations
            ),
        )

    def _needed(self) -> list[int]:
        """What the roots and the violations depend on, in the old order."""
        watched = (k for v in self._typed.violations for k in (v.quantise, v.outside))
        found = {*self._typed.graph.roots, *watched}
        waiting = list(found)
        while waiting:
            fresh = [k for k in self._reads(waiting.pop()) if k not in found]
            found.update(fresh)
            waiting += fresh
        return sorted(found)

    def _reads(self, index: int) -> tuple[int, ...]:
        operation = self._typed.graph.operations[index]
        polynomial = self._sums.get(target) if (target := _target(operation)) else None
        if polynomial is None:
            return operands(operation)
        return tuple(k for factors in polynomial for k in factors)

    def _moved(self, index: int, operation: Operation) -> int:
        target, typed = _target(operation), self._typed
        origin, form, interval = typed.graph.origins[index], typed.formats[index], typed.intervals[index]
        if target is None or target not in self._sums:
            return self._emit(_renumbered(operation, self._new), origin, form, interval)
        if isinstance(operation, Quantise):
            return self._sum_of(target, operation.overflow, origin)
        value = self._sum_of(target, self._overflows.get(target, Overflow.WRAP), origin)
        return self._emit(SumOutside(value), origin, None, None)

    def _sum_of(self, target: _Target, overflow: Overflow, origin: str) -> int:
        """The sum of a target, made for the first that asks."""
        if (target, overflow) not in self._made:
            terms = tuple(self._terms(self._sums[target], target.form))
            made = SumOfProducts(terms, target.form, target.rounding, overflow)
            place = self._emit(made, origin, target.form, of_format(target.form))
            self._made[target, overflow] = place
        return self._made[target, overflow]

    def _terms(self, polynomial: _Polynomial, form: Fixed) -> Iterator[Product]:
        """The products; those whose operands are there first, by a rough count, come first.

        Constants have as many bits as bring the product to its ``_usual`` place, if they have room.
        """
        finest = form.fraction + self._usual
        for factors, value in sorted(polynomial.items(), key=lambda term: (self._depth_of(term[0]), term[0])):
            match factors:
                case ():
                    one = self._constant(Fraction(1), 0)
                    yield Product(one, self._constant(abs(value), finest), value < 0)
                case (a,):
                    by = self._constant(abs(value), finest - self._fraction(factors))
                    yield Product(self._new[a], by, value < 0)
                case (a, b):
                    yield from self._powers(a, b, value)
                case _:
                    raise AssertionError(factors)

    def _powers(self, a: int, b: int, value: Fraction) -> Iterator[Product]:
        """Two values times a constant: the first with its binary point moved, for each digit."""
        point = 1 - value.denominator.bit_length()
        for sign, exponent in canonical_signed_digits(value.numerator):
            moved = self._new[a]
            if exponent + point:
                form, interval = self._formats[moved], self._intervals[moved]
                assert form is not None
                form = Fixed(width=form.width, fraction=form.fraction - exponent - point, signed=form.signed)
                moved = self._emit(Shift(moved, exponent + point), "", form, interval)
            yield Product(moved, self._new[b], sign < 0)

    def _depth_of(self, factors: _Factors) -> int:
        return max((self._depths[self._new[k]] for k in factors), default=0)

    @cached_property
    def _usual(self) -> int:
        """By how many bits most products of two values are finer than their sum's format."""
        finer = Counter(
            self._fraction(factors) - target.form.fraction
            for target, polynomial in self._sums.items()
            for factors in polynomial
            if len(factors) > 1
        )
        return max(finer, key=lambda bits: (finer[bits], bits), default=0)

    def _fraction(self, factors: _Factors) -> int:
        return sum(form.fraction for k in factors if (form := self._typed.formats[k]) is not None)

    def _constant(self, value: Fraction, fraction: int) -> int:
        """A constant with so many fraction bits, or as near to it as it can be."""
        form, interval = constant_type(value)
        room = self._widest - 1 - form.width
        more = min(max(fraction - form.fraction, 0), room)
        key = value, form.fraction + more
        if key not in self._constants:
            wider = Fixed(width=form.width + more, fraction=form.fraction + more, signed=False)
            raws = Interval(low=interval.low << more, high=interval.high << more)
            self._constants[key] = self._emit(Constant(value), "", wider, raws)
        return self._constants[key]

    def _emit(self, operation: Operation, origin: str, form: Fixed | None, interval: Interval | None) -> int:
        self._operations.append(operation)
        self._origins.append(origin)
        self._formats.append(form)
        self._intervals.append(interval)
        self._depths.append(self._depth(operation))
        return len(self._operations) - 1

    def _depth(self, operation: Operation) -> int:
        """Roughly in which turn the value is there: most take one, a sum one a product and some more."""
        before = (self._depths[k] - lag for k, lag in zip(operands(operation), lags(operation), strict=True))
        match operation:
            case SumOfProducts(terms):
                return max(before) + len(terms) + _TURNS_OF_A_SUM
            case Divide() | Reciprocal():
                return max(before) + _TURNS_OF_A_QUOTIENT
            case _:
                return max(before, default=-1) + 1


def _renumbered(operation: Operation, new: Mapping[int, int]) -> Operation:
    changed: dict[str, Any] = {
        each.name: new[getattr(operation, each.name)]
        for each in fields(operation)
        if each.name in ("flag", "a", "b")
    }
    return replace(operation, **changed) if changed else operation
