"""Numbers and flags under tracing: what an algorithm computes with in place of floats."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.builder import Builder


class Signal:
    """A value of a graph under construction; arithmetic on it adds operations."""

    __slots__ = ("builder", "index")
    # NumPy scalars leave arithmetic with a Signal to the Signal.
    __array_ufunc__ = None

    def __init__(self, builder: Builder, index: int) -> None:
        self.builder = builder
        self.index = index

    def _lift(self, other: Any) -> int:
        return other.index if isinstance(other, Signal) else self.builder.number(float(other))

    def _signal(self, index: int) -> "Signal":
        return Signal(self.builder, index)

    def __add__(self, other: Any) -> "Signal":
        return self._signal(self.builder.add(self.index, self._lift(other)))

    __radd__ = __add__

    def __sub__(self, other: Any) -> "Signal":
        return self._signal(self.builder.subtract(self.index, self._lift(other)))

    def __rsub__(self, other: Any) -> "Signal":
        return self._signal(self.builder.subtract(self._lift(other), self.index))

    def __mul__(self, other: Any) -> "Signal":
        return self._signal(self.builder.multiply(self.index, self._lift(other)))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Signal":
        return self._signal(self.builder.divide(self.index, self._lift(other)))

    def __rtruediv__(self, other: Any) -> "Signal":
        return self._signal(self.builder.divide(self._lift(other), self.index))

    def __pow__(self, exponent: Any) -> "Signal":
        """A power by a whole number other than 0: squares, multiplied together."""
        if isinstance(exponent, Signal) or int(exponent) != exponent or not exponent:
            return NotImplemented
        result, square, rest = None, self, abs(int(exponent))
        while rest:
            if rest % 2:
                result = square if result is None else result * square
            square, rest = square * square if rest > 1 else square, rest // 2
        assert result is not None
        return 1.0 / result if exponent < 0 else result

    def __neg__(self) -> "Signal":
        return self._signal(self.builder.negate(self.index))


Scalar = float | NDArray[np.float64] | Signal
Condition = bool | NDArray[np.bool_] | Signal
# Arrays of object: every element is a float, an array over tracks, or a Signal.
Array = NDArray[Any]


def select(condition: Condition, a: Scalar, b: Scalar) -> Any:
    """a where the condition holds, else b, for one element."""
    if isinstance(condition, Signal):
        builder = condition.builder
        index = builder.select(condition.index, _index(builder, a), _index(builder, b))
        return Signal(builder, index)
    chosen: Any = np.where(condition, a, b)  # type: ignore[arg-type]
    return chosen if chosen.ndim else float(chosen)


def row(number: Scalar, rows: Sequence[float]) -> Any:
    """The row of a number, which is whole and not beyond the last row."""
    if isinstance(number, Signal) and min(rows) < max(rows):
        return Signal(number.builder, number.builder.row(number.index, rows))
    return float(rows[0]) if isinstance(number, Signal) else np.asarray(rows)[np.asarray(number, int)]


def negative(a: Scalar) -> Any:
    """The condition a < 0."""
    if isinstance(a, Signal):
        return Signal(a.builder, a.builder.negative(a.index))
    return np.less(a, 0)


def minimum(a: Scalar, b: Scalar) -> Any:
    """The lesser of two elements."""
    return select(negative(a - b), a, b)


def both(a: Condition, b: Condition) -> Any:
    """The condition a and b."""
    if isinstance(a, Signal) and isinstance(b, Signal):
        return Signal(a.builder, a.builder.both(a.index, b.index))
    return np.logical_and(a, b)  # type: ignore[arg-type]


def opposite(a: Condition) -> Any:
    """The condition not a."""
    if isinstance(a, Signal):
        return Signal(a.builder, a.builder.opposite(a.index))
    return np.logical_not(a)


def is_zero(value: Scalar) -> bool:
    """Whether an element is zero: for a Signal structurally, for every track and input."""
    if isinstance(value, Signal):
        return value.builder.value(value.index) == 0
    return bool(np.all(np.equal(value, 0.0)))


def named(origin: str, array: Array) -> Array:
    """Name the elements of an array, ``update: S`` giving ``update: S[0,1]``; returns the array."""
    for place in np.ndindex(*array.shape):
        named_at(origin, place, array[place])
    return array


def named_at(origin: str, place: tuple[int, ...], element: Scalar) -> None:
    """Name one element of what would be an array."""
    if isinstance(element, Signal):
        element.builder.name(element.index, f"{origin}[{','.join(map(str, place))}]")


def _index(builder: Builder, value: Scalar) -> int:
    return value.index if isinstance(value, Signal) else builder.number(float(value))
