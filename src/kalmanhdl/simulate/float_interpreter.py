"""One step of a floating-point graph in Python integers: what the compiled engine must give."""

from collections.abc import Mapping
from typing import assert_never

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Constant,
    Divide,
    Flag,
    Function,
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
from kalmanhdl.numerics.float_functions import KEPT
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.simulate.interpreter import Step


def interpret_float(typed: FloatGraph, given: Mapping[str, int], state: Mapping[str, int]) -> Step:
    """Evaluate one step exactly; ``saturated`` holds the values of the graph's violations that are
    infinite or NaN. Of a product that is part of a fused multiply-add the value is 0.
    """
    values: list[int] = []
    named = {**given, **state}
    for index, operation in enumerate(typed.graph.operations):
        values.append(0 if index in typed.fused else int(_value(typed, index, operation, values, named)))
    unbounded = (v.value for v in typed.violations if not _is_finite(typed.form, values[v.value]))
    return Step(tuple(values), frozenset(unbounded))


def _is_finite(form: Float, raw: int) -> bool:
    return form.magnitude(raw) < form.infinity


def _value(
    typed: FloatGraph, index: int, operation: Operation, values: list[int], named: Mapping[str, int]
) -> int:
    form = typed.form
    match operation:
        case Input(name) | State(name):
            return form.canonical(named[name])
        case Flag(name) | StateFlag(name):
            return named[name]
        case Constant(value):
            return form.nearest(value)
        case Add(a, b) | Subtract(a, b):
            return _sum(typed, index, a, b, isinstance(operation, Subtract), values)
        case Multiply(a, b):
            return floating.multiply(form, values[a], values[b])
        case Shift(a, exponent):
            return floating.scale(form, values[a], exponent)
        case Divide(a, b):
            return floating.divide(form, values[a], values[b])
        case Reciprocal(a):
            return floating.divide(form, form.nearest(1.0), values[a])
        case Unary(function, a):
            return _function(form, function, values[a])
        case Table(a, rows):
            return form.nearest(rows[row_index(form, values[a], len(rows))])
        case Select(flag, a, b):
            return values[a] if values[flag] else values[b]
        case NotFinite(a):
            return not _is_finite(form, values[a])
        case Negative(a):
            return floating.is_negative(form, values[a])
        case And(a, b):
            return values[a] & values[b]
        case Or(a, b):
            return values[a] | values[b]
        case Not(a):
            return 1 - values[a]
        case Quantise() | Bits() | Outside() | SumOfProducts() | SumOutside() | Binary():
            raise AssertionError(f"{operation} in a graph of floating-point numbers")
        case _ as never:
            assert_never(never)


def _sum(typed: FloatGraph, index: int, a: int, b: int, is_difference: bool, values: list[int]) -> int:
    form = typed.form

    def signed(operand: int, negative: bool) -> int:
        return floating.negate(form, values[operand]) if negative else values[operand]

    fused = typed.fused_sum(index)
    if fused is not None:
        factors = typed.graph.operations[fused.product]
        assert isinstance(factors, Multiply)
        first, added = signed(factors.a, fused.minus_product), signed(fused.addend, fused.minus_addend)
        return floating.fused_multiply_add(form, first, values[factors.b], added)
    return floating.add(form, values[a], signed(b, is_difference))


def row_index(form: Float, raw: int, rows: int) -> int:
    """The number of the row that a value asks for: its whole part, within the table; of NaN the first."""
    if form.is_nan(raw) or raw & form.sign:
        return 0
    return rows - 1 if form.is_infinite(raw) else min(int(form.real(raw)), rows - 1)


def _function(form: Float, function: Function, a: int) -> int:
    assert function in KEPT, function
    return floating.wrap(form, a) if function is Function.WRAP else floating.square_root(form, a)
