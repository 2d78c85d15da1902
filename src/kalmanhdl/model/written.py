"""Formulas as strings that ``model.expression`` reads back to equal ones."""

import math
from collections.abc import Mapping, Sequence
from enum import IntEnum

from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Constant,
    Divide,
    Function,
    Input,
    Multiply,
    Operation,
    Reciprocal,
    Shift,
    Subtract,
    Unary,
)
from kalmanhdl.model.expression import MAX_FORMULA
from kalmanhdl.model.formulas import Formulas

_TURN, _PER_TURN = repr(math.tau), repr(1 / math.tau)
_WORDS = {
    Function.SINE: "sin",
    Function.COSINE: "cos",
    Function.SQUARE_ROOT: "sqrt",
    Function.EXPONENTIAL: "exp",
    Function.WRAP: "wrap",
    Function.ARCTANGENT: "atan2",
    Function.HYPOTENUSE: "hypot",
}


class _Binding(IntEnum):
    """What holds a text together: its last operation."""

    SUM = 0
    PRODUCT = 1
    ATOM = 2


def written(formulas: Formulas, names: Mapping[str, Sequence[str]]) -> tuple[str, ...] | None:
    """The formulas of a vector, with names for the elements of the vectors by letter.

    None where one of them is longer than a string may be: a graph that shares much has no short text.
    """
    parts: list[tuple[str, _Binding]] = []
    for operation in formulas.graph.operations:
        parts.append(_part(operation, parts, names))
        if len(parts[-1][0]) > MAX_FORMULA:
            return None
    return tuple(parts[root][0] for _, root in formulas.graph.outputs)


def _part(
    operation: Operation, parts: list[tuple[str, _Binding]], names: Mapping[str, Sequence[str]]
) -> tuple[str, _Binding]:
    def text(index: int, least: _Binding) -> str:
        found, binding = parts[index]
        return found if binding >= least else f"({found})"

    match operation:
        case Input(name):
            letter, _, place = name.rstrip("]").partition("[")
            return names[letter][int(place)], _Binding.ATOM
        case Constant(value):
            return repr(float(value)), _Binding.ATOM if value >= 0 else _Binding.SUM
        case Add(a, b):
            return f"{text(a, _Binding.SUM)} + {text(b, _Binding.PRODUCT)}", _Binding.SUM
        case Subtract(a, b):
            return f"{text(a, _Binding.SUM)} - {text(b, _Binding.PRODUCT)}", _Binding.SUM
        case Multiply(a, b):
            return f"{text(a, _Binding.PRODUCT)}*{text(b, _Binding.ATOM)}", _Binding.PRODUCT
        case Shift(a, exponent):
            return f"{2.0**exponent!r}*{text(a, _Binding.ATOM)}", _Binding.PRODUCT
        case Divide(a, b):
            return f"{text(a, _Binding.PRODUCT)}/{text(b, _Binding.ATOM)}", _Binding.PRODUCT
        case Reciprocal(a):
            return f"1/{text(a, _Binding.ATOM)}", _Binding.PRODUCT
        case Unary(function, a):
            return _of_unary(function, text(a, _Binding.SUM), text(a, _Binding.ATOM))
        case Binary(function, a, b):
            call = f"{_WORDS[function]}({text(a, _Binding.SUM)}, {text(b, _Binding.SUM)})"
            if function is Function.HYPOTENUSE:
                return call, _Binding.ATOM
            return f"{_PER_TURN}*{call}", _Binding.PRODUCT
        case _:
            raise AssertionError(f"{operation} is no operation of formulas")


def _of_unary(function: Function, argument: str, factor: str) -> tuple[str, _Binding]:
    """Angles of a graph are in turns, those of a string in radians."""
    word = _WORDS[function]
    if function in (Function.SQUARE_ROOT, Function.EXPONENTIAL):
        return f"{word}({argument})", _Binding.ATOM
    call = f"{word}({_TURN}*{factor})"
    return (f"{_PER_TURN}*{call}", _Binding.PRODUCT) if function is Function.WRAP else (call, _Binding.ATOM)
