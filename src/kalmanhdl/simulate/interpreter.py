"""One step of a typed graph in Python integers.

This defines what the compiled engine must give, and replaces it where no C compiler is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

from kalmanhdl.arithmetic.division import divide, reciprocal
from kalmanhdl.arithmetic.fixed import Fixed, Rounding, outside, quantise, rounded, wrapped
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Constant,
    Divide,
    Flag,
    Input,
    Multiply,
    Negative,
    Not,
    NotFinite,
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
    SumOfProducts,
    SumOutside,
    Table,
    Unary,
)
from kalmanhdl.numerics.typed import TypedGraph


@dataclass(frozen=True, slots=True)
class Step:
    """The values of one step: a raw integer or a flag per operation, and what saturated.

    ``saturated`` holds the indices of the operations whose rounded value lay outside their format.
    """

    values: tuple[int, ...]
    saturated: frozenset[int]


def interpret(typed: TypedGraph, given: Mapping[str, int], state: Mapping[str, int]) -> Step:
    """Evaluate one step exactly. ``given`` has the inputs and flags by name, ``state`` the states.

    A divisor below zero, which no variance is, counts as zero.
    """
    values: list[int] = []
    saturated = set()
    named = {**given, **state}
    for index, operation in enumerate(typed.graph.operations):
        value, out = _evaluate(typed, index, operation, values, named)
        values.append(int(value))
        if out:
            saturated.add(index)
    return Step(tuple(values), frozenset(saturated))


def next_state(typed: TypedGraph, values: Sequence[int]) -> dict[str, int]:
    """The states that a step leaves, by name, at the fraction that each state is read with."""
    operations = typed.graph.operations
    places = {o.name: i for i, o in enumerate(operations) if isinstance(o, State)}
    state = {}
    for name, root in typed.graph.states:
        state[name] = values[root]
        if name in places:
            state[name] <<= _form(typed, places[name]).fraction - _form(typed, root).fraction
    return state


def _form(typed: TypedGraph, index: int) -> Fixed:
    form = typed.formats[index]
    assert form is not None
    return form


def _evaluate(
    typed: TypedGraph, index: int, operation: Operation, values: list[int], named: Mapping[str, int]
) -> tuple[int, bool]:
    """The value of an operation, and whether it lay outside of its format."""

    def aligned(operand: int) -> int:
        return values[operand] << (_form(typed, index).fraction - _form(typed, operand).fraction)

    match operation:
        case Input(name) | State(name) | Flag(name) | StateFlag(name):
            return named[name], False
        case Constant(value):
            raw = value / _form(typed, index).resolution
            assert raw.denominator == 1
            return int(raw), False
        case Add(a, b):
            return aligned(a) + aligned(b), False
        case Subtract(a, b):
            return aligned(a) - aligned(b), False
        case Multiply(a, b):
            return values[a] * values[b], False
        case Shift(a):
            return values[a], False
        case Select(flag, a, b):
            return aligned(a) if values[flag] else aligned(b), False
        case Quantise(a, form, rounding, overflow):
            return quantise(values[a], _form(typed, a).fraction, form, rounding, overflow)
        case SumOfProducts(_, form, rounding, overflow):
            return quantise(*_exact_sum(typed, operation, values), form, rounding, overflow)
        case SumOutside(a):
            summed = typed.graph.operations[a]
            assert isinstance(summed, SumOfProducts)
            exact, fraction = _exact_sum(typed, summed, values)
            return outside(
                rounded(exact, fraction - summed.form.fraction, summed.rounding), summed.form
            ), False
        case Bits(a, form):
            floor = rounded(values[a], _form(typed, a).fraction - form.fraction, Rounding.FLOOR)
            return wrapped(floor, form), False
        case Table(a, rows):
            return int(rows[values[a]] / _form(typed, index).resolution), False
        case Divide() | Reciprocal():
            return _quotient(typed, index, operation, values)
        case Outside(a, form, rounding):
            dropped = _form(typed, a).fraction - form.fraction
            return outside(rounded(values[a], dropped, rounding), form), False
        case Negative(a):
            return values[a] < 0, False
        case And(a, b):
            return values[a] & values[b], False
        case Or(a, b):
            return values[a] | values[b], False
        case Not(a):
            return 1 - values[a], False
        case Unary() | Binary() | NotFinite():
            raise AssertionError(f"{operation} in a graph of integers")
        case _ as never:
            assert_never(never)


def _exact_sum(typed: TypedGraph, operation: SumOfProducts, values: list[int]) -> tuple[int, int]:
    """The sum of the products as a raw integer, and its fraction."""
    fractions = [_form(typed, term.a).fraction + _form(typed, term.b).fraction for term in operation.terms]
    finest = max(fractions)
    total = 0
    for term, fraction in zip(operation.terms, fractions, strict=True):
        product = values[term.a] * values[term.b] << finest - fraction
        total += -product if term.negative else product
    return total, finest


def _quotient(
    typed: TypedGraph, index: int, operation: Divide | Reciprocal, values: list[int]
) -> tuple[int, bool]:
    form, rounding = _form(typed, index), typed.division_rounding
    if isinstance(operation, Reciprocal):
        divisor, fraction = max(values[operation.a], 0), _form(typed, operation.a).fraction
        return reciprocal(divisor, fraction, form, rounding, typed.division)
    a, b = operation.a, operation.b
    fractions = _form(typed, a).fraction, _form(typed, b).fraction
    return divide(values[a], fractions[0], max(values[b], 0), fractions[1], form, rounding)
