"""Functions of a model, such as f(x, u), as graphs: worked out over elements, differentiated, written down.

They come from strings, from SymPy expressions or from Python functions over elements.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.builder import Builder, reachable
from kalmanhdl.graph.derivative import derivatives
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Constant,
    Divide,
    Graph,
    Input,
    Multiply,
    Operation,
    Reciprocal,
    Shift,
    Subtract,
    Unary,
)
from kalmanhdl.graph.signal import Array, Signal
from kalmanhdl.math import applied
from kalmanhdl.model.checks import fault
from kalmanhdl.model.expression import ExpressionError, formula
from kalmanhdl.model.symbolic import text_of
from kalmanhdl.validation import as_tuple, shown

Function = Callable[..., Sequence[Any]]
Given = Sequence[Any] | Function
"""Formulas as a user gives them: strings, SymPy expressions and numbers in a list, or a Python function."""

MAX_OPERATIONS = 2000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Formulas:
    """An array of formulas in the elements of vectors, whose leaves are ``x[0]``, ``u[1]`` and so on.

    Outputs of the graph stand in the order of the array.
    """

    graph: Graph
    shape: tuple[int, ...]

    def __call__(self, **vectors: Array) -> Array:
        """The array over elements of the vectors that the formulas name."""
        values: list[Any] = []
        for operation in self.graph.operations:
            values.append(_value(operation, values, vectors))
        result = np.empty(math.prod(self.shape), object)
        for place, (_, root) in enumerate(self.graph.outputs):
            result[place] = values[root]
        return result.reshape(self.shape)

    def jacobian(self, letter: str, count: int) -> "Formulas":
        """The derivatives of a vector of formulas by the ``count`` elements of a vector. Shape (k, count)."""
        builder = Builder()
        roots = _onto(builder, self.graph)
        columns = [derivatives(builder, roots, builder.intern(Input(f"{letter}[{i}]"))) for i in range(count)]
        found = [column[row] for row in range(len(roots)) for column in columns]
        return _formulas(builder, found, (len(roots), count))

    def dependence(self, letter: str, count: int) -> NDArray[np.bool_]:
        """Which formulas depend on which elements of a vector. Shape (number of formulas, count)."""
        found = np.zeros((len(self.graph.outputs), count), bool)
        for row, (_, root) in enumerate(self.graph.outputs):
            for index in reachable(self.graph.operations, [root]):
                operation = self.graph.operations[index]
                if isinstance(operation, Input) and operation.name.startswith(f"{letter}["):
                    found[row, int(operation.name[len(letter) + 1 : -1])] = True
        return found


def formulas(
    key: str,
    given: Given,
    count: int,
    arguments: Mapping[str, Sequence[str]],
    constants: Mapping[str, float],
) -> Formulas:
    """``count`` formulas of a model's key, from whatever form they are given in.

    ``arguments`` are the vectors by their letters, with the names of their elements; a Python function
    takes those vectors that have elements, in their order.

    Raises:
        ModelError: what is given is no such list or function; the message names key and element.
    """
    builder = Builder()
    vectors = {letter: _leaves(builder, letter, len(names)) for letter, names in arguments.items()}
    if callable(given):
        entries = _called(key, given, [vector for vector in vectors.values() if len(vector)])
    else:
        variables = {
            name: element
            for letter, names in arguments.items()
            for name, element in zip(names, vectors[letter], strict=True)
        }
        entries = _parsed(key, texts(key, given), {**constants, **variables})
    if len(entries) != count:
        raise fault(key, f" has {len(entries)} formulas: write {count}")
    roots = [_index(builder, f"{key}[{place}]", entry) for place, entry in enumerate(entries)]
    if len(builder.operations) > MAX_OPERATIONS:
        raise fault(key, f" has more than {MAX_OPERATIONS} operations: write it shorter")
    return _formulas(builder, roots, (count,))


def texts(key: str, given: object) -> tuple[str, ...]:
    """The strings that a list of strings, numbers and SymPy expressions stands for. Raises ModelError."""
    entries = as_tuple(given)
    if entries is None:
        raise fault(key, f' = {shown(given)} is no list: write one such as ["x + T*v", "v"]')
    found = []
    for place, entry in enumerate(entries):
        text = entry if isinstance(entry, str) else text_of(entry)
        if text is None:
            problem = f"[{place}] = {shown(entry)} is no formula: a string, a number or a SymPy expression"
            raise fault(key, problem)
        found.append(text)
    return tuple(found)


def _called(key: str, function: Function, vectors: list[Array]) -> list[Any]:
    try:
        return list(function(*vectors))
    except Exception as error:
        # Whatever the user's own function raises.
        remedy = "a function computes with + - * / and the functions of kalmanhdl.math on its elements"
        raise fault(key, f": the function fails on symbols ({error}): {remedy}") from None


def _parsed(key: str, given: Sequence[str], values: Mapping[str, float | Signal]) -> list[Any]:
    found = []
    for place, text in enumerate(given):
        try:
            found.append(formula(text, values))
        except ExpressionError as error:
            raise fault(key, f"[{place}]: {error}") from None
    return found


def _leaves(builder: Builder, letter: str, count: int) -> Array:
    leaves = np.empty(count, object)
    for place in range(count):
        leaves[place] = Signal(builder, builder.intern(Input(f"{letter}[{place}]")))
    return leaves


def _index(builder: Builder, place: str, entry: object) -> int:
    if isinstance(entry, Signal) and entry.builder is builder:
        return entry.index
    try:
        number = float(entry)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise fault(place, f" = {shown(entry)} is neither a number nor made of the variables") from None
    if not math.isfinite(number):
        raise fault(place, f" = {number} is not finite")
    return builder.constant(number)


def _formulas(builder: Builder, roots: Sequence[int], shape: tuple[int, ...]) -> Formulas:
    outputs = [(str(place), root) for place, root in enumerate(roots)]
    return Formulas(graph=builder.graph([], outputs), shape=shape)


def _onto(builder: Builder, graph: Graph) -> list[int]:
    moved: dict[int, int] = {}
    for index, operation in enumerate(graph.operations):
        moved[index] = builder.rebuild(operation, moved)
    return [moved[root] for _, root in graph.outputs]


def _value(operation: Operation, v: list[Any], vectors: Mapping[str, Array]) -> Any:
    match operation:
        case Input(name):
            letter, _, place = name.rstrip("]").partition("[")
            return vectors[letter][int(place)]
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
            return applied(function, v[a])
        case Binary(function, a, b):
            return applied(function, v[a], v[b])
        case _:
            raise AssertionError(f"{operation} is no operation of formulas")
