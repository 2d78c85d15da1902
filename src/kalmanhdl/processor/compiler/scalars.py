"""Formulas on the processor: numbers in element 0 of matrices, each with a power of two of its own.

A number is its matrix's element 0 times 2**exponent: shifts cost nothing, and what is multiplied or inverted
is brought near one, where it has the most digits. How large numbers become, samples tell.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Constant,
    Divide,
    Function,
    Graph,
    Input,
    Multiply,
    Operation,
    Reciprocal,
    Shift,
    Subtract,
    Unary,
)
from kalmanhdl.processor.compiler.graph import Computed, Matrix, Vector, named
from kalmanhdl.processor.compiler.recipe import Matrices
from kalmanhdl.processor.instructions import FUNCTIONS, Opcode

_ROOM = 6
"""The power of two that no sum and no product of two numbers exceeds, as far as samples tell."""

_MOST = 4
"""The power of two that an instruction scales by at most: most formats have both it and its reciprocal."""

_ANGLES = (Function.SINE, Function.COSINE, Function.WRAP, Function.EXPONENTIAL)
_WORDS: Mapping[type[Operation], str] = {
    Add: "a sum",
    Subtract: "a difference",
    Multiply: "a product",
    Divide: "a quotient",
    Reciprocal: "a reciprocal",
}
_Placed = TypeVar("_Placed", Vector, Matrix)


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """Element 0 of a matrix times 2**exponent."""

    matrix: Matrix
    exponent: int = 0


@dataclass(slots=True, kw_only=True)
class _Lowering:
    """The values of a graph so far, and for each the powers of two of its largest and its middle value."""

    m: Matrices
    where: str
    graph: Graph
    leaves: Mapping[str, Matrix]
    levels: Sequence[int]
    middles: Sequence[int]
    found: list[Number] = field(default_factory=list)

    def run(self) -> None:
        for index, operation in enumerate(self.graph.operations):
            self.found.append(self._lowered(index, operation))

    def _lowered(self, index: int, operation: Operation) -> Number:
        match operation:
            case Input(name):
                return Number(matrix=self.leaves[name])
            case Constant(value):
                return self._constant(float(value))
            case Shift(a, exponent):
                return replace(self.found[a], exponent=self.found[a].exponent + exponent)
            case Add(a, b):
                x, y = self._aligned(a, b)
                return self._named(index, Number(matrix=x.matrix + y.matrix, exponent=x.exponent))
            case Subtract(a, b):
                x, y = self._aligned(a, b)
                return self._named(index, Number(matrix=x.matrix - y.matrix, exponent=x.exponent))
            case Multiply(a, b):
                return self._product(index, a, self.found[a], self.levels[a], b)
            case Reciprocal(a):
                return self._named(index, self._reciprocal(a))
            case Divide(a, b):
                return self._product(index, a, self._reciprocal(b), -self.middles[b], a)
            case Unary(function, a):
                return self._unary(index, function, a)
            case Binary(function, a, b):
                x, y = self._aligned(a, b)
                pair = placed(self.m.c("pair", np.zeros((1, 2))), {0: x.matrix, 1: y.matrix})
                exponent = x.exponent if function is Function.HYPOTENUSE else 0
                return self._named(index, Number(matrix=self._function(function, pair), exponent=exponent))
            case _:
                raise AssertionError(f"{operation} is no operation of formulas")

    def _constant(self, value: float) -> Number:
        exponent = math.frexp(value)[1] if value else 0
        array = np.array([[math.ldexp(value, -exponent)]])
        return Number(matrix=self.m.c("C", array), exponent=exponent)

    def _product(self, index: int, a: int, x: Number, level: int, b: int) -> Number:
        """x times b; ``level`` is that of x."""
        y = self.found[b]
        x, y = self._small(x, level), self._small(y, self.levels[b])
        while (over := level - x.exponent + self.levels[b] - y.exponent - _ROOM) > 0:
            if level - x.exponent >= self.levels[b] - y.exponent:
                x = _scaled(x, x.exponent + min(over, 4))
            else:
                y = _scaled(y, y.exponent + min(over, 4))
        product = Number(matrix=x.matrix.elementwise(y.matrix), exponent=x.exponent + y.exponent)
        return self._named(index, product)

    def _small(self, number: Number, level: int) -> Number:
        """One that has few digits before the point is brought up to it."""
        return _scaled(number, level) if level - number.exponent < -1 else number

    def _reciprocal(self, a: int) -> Number:
        """1 / a, the middle of a being one: a and its reciprocal have equally many digits."""
        number = _scaled(self.found[a], self.middles[a])
        return Number(matrix=number.matrix.alone(Opcode.RECIP, (1, 1)), exponent=-number.exponent)

    def _unary(self, index: int, function: Function, a: int) -> Number:
        number = self.found[a]
        if function in _ANGLES:
            number = _scaled(number, 0)
        elif number.exponent % 2:
            number = _scaled(number, number.exponent - 1)
        value = self._function(function, number.matrix)
        return self._named(index, Number(matrix=value, exponent=number.exponent // 2))

    def _aligned(self, a: int, b: int) -> tuple[Number, Number]:
        """Both with one exponent: the lower one where that leaves them room."""
        x, y = self.found[a], self.found[b]
        low, high = sorted((x.exponent, y.exponent))
        exponent = low if max(self.levels[a], self.levels[b]) - low <= _ROOM else high
        return _scaled(x, exponent), _scaled(y, exponent)

    def _function(self, function: Function, of: Matrix) -> Matrix:
        builder = of.builder
        index = builder.place(Computed(Opcode.FUNC, (of.index,), FUNCTIONS.index(function)))
        return Matrix(builder, index, (1, 1))

    def _named(self, index: int, number: Number) -> Number:
        operation = self.graph.operations[index]
        if isinstance(operation, Unary | Binary):
            what = operation.function.value.replace("_", " ")
        else:
            what = _WORDS[type(operation)]
        named(number.matrix, self.graph.origins[index] or f"{self.where}: {what} of its formulas")
        return number


def _scaled(number: Number, exponent: int) -> Number:
    """The same number with another exponent."""
    matrix, left = number.matrix, number.exponent - exponent
    while left:
        by = max(min(left, _MOST), -_MOST)
        index = matrix.builder.place(Computed(Opcode.SCALE, (matrix.index,), by))
        matrix, left = Matrix(matrix.builder, index, (1, 1)), left - by
    return Number(matrix=matrix, exponent=exponent)


def numbers(
    m: Matrices,
    where: str,
    graph: Graph,
    leaves: Mapping[str, Matrix],
    known: Mapping[str, NDArray[np.float64]],
) -> list[Matrix]:
    """The outputs of a graph of reals in element 0 of matrices.

    ``leaves`` are its inputs by name, ``known`` samples of them.
    """
    with np.errstate(all="ignore"):
        values = [np.abs(np.asarray(each, float)) for each in evaluate(graph, known)]
    there = [value[np.isfinite(value) & (value > 0)] for value in values]
    levels = [math.frexp(float(value.max(initial=0.0)))[1] for value in there]
    middles = [_middle(value) for value in there]
    lowering = _Lowering(m=m, where=where, graph=graph, leaves=leaves, levels=levels, middles=middles)
    lowering.run()
    return [_scaled(lowering.found[root], 0).matrix for _, root in graph.outputs]


def _middle(value: NDArray[np.float64]) -> int:
    """The power of two between the least and the largest value."""
    if not len(value):
        return 0
    return round(float(np.log2(value.min()) + np.log2(value.max())) / 2)


def placed(base: _Placed, elements: Mapping[int, Matrix]) -> _Placed:
    """A matrix or a vector with element 0 of others in these places."""
    builder, index = base.builder, base.index
    for place, value in elements.items():
        index = builder.place(Computed(Opcode.PLACE, (value.index, index), place))
    changed: Any = {"index": index} | ({"known": None} if isinstance(base, Matrix) else {})
    return replace(base, **changed)
