"""A graph evaluated on reals: the value of every operation, for many samples at once."""

from collections.abc import Mapping
from typing import Any, assert_never

import numpy as np

from kalmanhdl.graph.functions import value_of
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Coefficient,
    Constant,
    Divide,
    Flag,
    Graph,
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


def evaluate(graph: Graph, leaves: Mapping[str, Any]) -> list[Any]:
    """The value of each operation as floats or arrays over samples; flags are booleans.

    ``leaves`` gives inputs, flags and states by name. Formats are ignored: a ``Quantise`` passes its
    operand, an ``Outside`` is false.
    """
    values: list[Any] = []
    for operation in graph.operations:
        values.append(_value(operation, values, leaves))
    return values


def _value(operation: Operation, v: list[Any], leaves: Mapping[str, Any]) -> Any:
    match operation:
        case Coefficient(value=value):
            return float(value)
        case Input(name) | Flag(name) | State(name) | StateFlag(name):
            return leaves[name]
        case Constant(value):
            return float(value)
        case Add(a, b):
            return v[a] + v[b]
        case Subtract(a, b):
            return v[a] - v[b]
        case Multiply(a, b):
            return v[a] * v[b]
        case Shift(a, exponent):
            return v[a] * 2.0**exponent
        case Divide(a, b):
            return v[a] / v[b]
        case Reciprocal(a):
            return 1.0 / v[a]
        case Unary(function, a):
            return value_of(function, v[a])
        case Binary(function, a, b):
            return value_of(function, v[a], v[b])
        case Table(a, rows):
            return np.array([float(row) for row in rows])[np.asarray(v[a], int)]
        case Select(flag, a, b):
            return np.where(v[flag], v[a], v[b])
        case Quantise(a):
            return v[a]
        case SumOfProducts(terms):
            return sum((-1 if term.negative else 1) * v[term.a] * v[term.b] for term in terms)
        case Bits(a, form):
            raw = np.floor(np.asarray(v[a]) / float(form.resolution))
            return (np.mod(raw - form.lowest, 2.0**form.width) + form.lowest) * float(form.resolution)
        case Outside() | SumOutside():
            return False
        case NotFinite(a):
            return np.logical_not(np.isfinite(v[a]))
        case Negative(a):
            return np.less(v[a], 0)
        case And(a, b):
            return np.logical_and(v[a], v[b])
        case Or(a, b):
            return np.logical_or(v[a], v[b])
        case Not(a):
            return np.logical_not(v[a])
        case _:
            assert_never(operation)
