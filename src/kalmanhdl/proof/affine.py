"""One step as an affine map of states and inputs, with an interval for what rounding adds, edge by edge.

On an edge of a set of reachable covariances all gains are known integers, so that what is left of the step is
affine but for its roundings. Values are real numbers in the units of the hardware. Source of the idea: affine
arithmetic, Comba & Stolfi 1993.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.graph.operations import (
    Add,
    And,
    Constant,
    Flag,
    Input,
    Multiply,
    Not,
    Operation,
    Or,
    Quantise,
    Select,
    Shift,
    State,
    Subtract,
)
from kalmanhdl.numerics.typed import TypedGraph

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# What a sum of products may lose in doubles, relative to the sizes of its terms: graphs are not that deep.
_LOST = 2.0**-40


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """slopes (E, k + i) times states and inputs, plus constant (E,), plus what is from low to high (E,).

    ``size`` (E, k + i + 1) bounds the terms that slopes and constant were made of.
    """

    slopes: Array
    constant: Array
    low: Array
    high: Array
    size: Array

    @property
    def fixed(self) -> bool:
        """Whether it is a known number on every edge."""
        return not (self.slopes.any() or self.low.any() or self.high.any())

    def scaled(self, factor: Array | float) -> "Affine":
        """The value times a number, one for all edges or one for each."""
        f = np.broadcast_to(np.asarray(factor, float), self.constant.shape)
        ends = np.sort([self.low * f, self.high * f], axis=0)
        return Affine(
            self.slopes * f[:, None], self.constant * f, ends[0], ends[1], self.size * np.abs(f)[:, None]
        )

    def plus(self, other: "Affine") -> "Affine":
        """The sum."""
        return Affine(
            self.slopes + other.slopes,
            self.constant + other.constant,
            self.low + other.low,
            self.high + other.high,
            self.size + other.size,
        )

    def widened(self, low: float, high: float) -> "Affine":
        """The value and an error."""
        return Affine(self.slopes, self.constant, self.low + low, self.high + high, self.size)

    def chosen(self, flags: Flags, other: "Affine") -> "Affine":
        """This where the flag holds, else the other."""
        pairs = (
            (self.slopes, other.slopes),
            (self.constant, other.constant),
            (self.low, other.low),
            (self.high, other.high),
            (self.size, other.size),
        )
        return Affine(*(np.where(flags.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))

    def lost(self, reach: Array) -> Array:
        """What doubles may have lost (E,), where states and inputs are within reach (E, k + i) of zero."""
        return np.asarray(((self.size[:, :-1] * reach).sum(axis=1) + self.size[:, -1]) * _LOST)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leaves:
    """What is known on each of E edges: flags by name, decided numbers and flags by operation, and the order
    of states and inputs, by name."""

    edges: int
    flags: Mapping[str, Flags]
    numbers: Mapping[int, Array]
    decided: Mapping[int, Flags]
    variables: Sequence[str]


def affine_forms(typed: TypedGraph, cone: Sequence[int], leaves: Leaves) -> dict[int, Affine]:
    """The affine forms of the numbers of a cone; those that are not affine are left out."""
    found: dict[int, Affine] = {}
    for index in cone:
        form = _form(typed, index, typed.graph.operations[index], found, leaves)
        if form is not None:
            found[index] = form
    return found


def flag_values(typed: TypedGraph, index: int, leaves: Leaves) -> Flags | None:
    """A flag on every edge, None where it depends on more than is known."""
    if index in leaves.decided:
        return leaves.decided[index]
    match typed.graph.operations[index]:
        case Flag(name):
            return leaves.flags.get(name)
        case Not(a):
            inner = flag_values(typed, a, leaves)
            return None if inner is None else ~inner
        case And(a, b):
            return _both(flag_values(typed, a, leaves), flag_values(typed, b, leaves))
        case Or(a, b):
            x, y = flag_values(typed, a, leaves), flag_values(typed, b, leaves)
            inverse = _both(None if x is None else ~x, None if y is None else ~y)
            return None if inverse is None else ~inverse
        case _:
            return None


def _both(a: Flags | None, b: Flags | None) -> Flags | None:
    if a is None or b is None:
        known = b if a is None else a
        # One that never holds decides.
        return known if known is not None and not known.any() else None
    return a & b


def _form(
    typed: TypedGraph, index: int, operation: Operation, found: Mapping[int, Affine], leaves: Leaves
) -> Affine | None:
    if index in leaves.numbers:
        return _number(leaves, leaves.numbers[index])
    match operation:
        case Constant(value):
            return _number(leaves, np.full(leaves.edges, float(value)))
        case Input(name) | State(name):
            return _variable(leaves, name) if name in leaves.variables else None
        case Add(a, b) | Subtract(a, b):
            x, y = found.get(a), found.get(b)
            if x is None or y is None:
                return None
            return x.plus(y if isinstance(operation, Add) else y.scaled(-1.0))
        case Shift(a, exponent):
            x = found.get(a)
            return None if x is None else x.scaled(2.0**exponent)
        case Multiply(a, b):
            return _product(found.get(a), found.get(b))
        case Select(flag, a, b):
            return _select(flag_values(typed, flag, leaves), found.get(a), found.get(b))
        case Quantise(a):
            x = found.get(a)
            return None if x is None else _rounded(typed, a, operation, x)
        case _:
            return None


def _number(leaves: Leaves, values: Array) -> Affine:
    count, zero = len(leaves.variables), np.zeros(leaves.edges)
    size = np.zeros((leaves.edges, count + 1))
    size[:, -1] = np.abs(values)
    return Affine(np.zeros((leaves.edges, count)), values, zero, zero, size)


def _variable(leaves: Leaves, name: str) -> Affine:
    slopes = np.zeros((leaves.edges, len(leaves.variables)))
    slopes[:, leaves.variables.index(name)] = 1.0
    zero = np.zeros(leaves.edges)
    return Affine(slopes, zero, zero, zero, np.hstack([slopes, zero[:, None]]))


def _product(x: Affine | None, y: Affine | None) -> Affine | None:
    if x is None or y is None or not (x.fixed or y.fixed):
        return None
    factor, value = (x, y) if x.fixed else (y, x)
    return value.scaled(factor.constant)


def _select(flags: Flags | None, a: Affine | None, b: Affine | None) -> Affine | None:
    if flags is None:
        return None
    if flags.all() or not flags.any():
        return a if flags.all() else b
    return None if a is None or b is None else a.chosen(flags, b)


def _rounded(typed: TypedGraph, a: int, operation: Quantise, value: Affine) -> Affine | None:
    """The value and its rounding error, as long as it stays in its format."""
    exact, form = typed.formats[a], operation.form
    assert exact is not None
    if exact.fraction <= form.fraction:
        return value
    step = float(form.resolution)
    rest = step - float(exact.resolution)
    match operation.rounding:
        case Rounding.FLOOR:
            return value.widened(-rest, 0.0)
        case Rounding.TOWARD_ZERO:
            return value.widened(-rest, rest)
        case Rounding.HALF_UP | Rounding.HALF_EVEN:
            return value.widened(-step / 2, step / 2)
