"""Derivatives of a graph's values with respect to one of its leaves, as operations of the same graph."""

import math
from collections.abc import Iterable

from kalmanhdl.graph.builder import Builder, reachable
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Constant,
    Divide,
    Function,
    Input,
    Multiply,
    Reciprocal,
    Shift,
    State,
    Subtract,
    Unary,
)


def derivatives(builder: Builder, roots: Iterable[int], leaf: int) -> list[int]:
    """The derivative of each root by a leaf, in forward mode.

    Divisions and functions share their reciprocals and their distances with the values themselves.
    """
    roots, zero = list(roots), builder.constant(0)
    slopes: dict[int, int] = {}
    for index in sorted(reachable(builder.operations, roots)):
        slopes[index] = builder.constant(1) if index == leaf else _slope(builder, index, slopes, zero)
    return [slopes[root] for root in roots]


def _slope(builder: Builder, index: int, slopes: dict[int, int], zero: int) -> int:
    """The derivative of one value from those of its operands."""
    match builder.operations[index]:
        case Constant() | Input() | State():
            return zero
        case Add(a, b):
            return builder.add(slopes[a], slopes[b])
        case Subtract(a, b):
            return builder.subtract(slopes[a], slopes[b])
        case Multiply(a, b):
            return builder.add(builder.multiply(a, slopes[b]), builder.multiply(b, slopes[a]))
        case Shift(a, exponent):
            return builder.shift(slopes[a], exponent)
        case Divide(a, b):
            change = builder.subtract(slopes[a], builder.multiply(index, slopes[b]))
            return builder.multiply(change, builder.reciprocal(b))
        case Reciprocal(a):
            return builder.negate(builder.multiply(builder.multiply(index, index), slopes[a]))
        case Unary(function, a):
            return zero if slopes[a] == zero else _of_unary(builder, function, index, a, slopes[a])
        case Binary(function, a, b):
            idle = slopes[a] == slopes[b] == zero
            return zero if idle else _of_binary(builder, function, index, (a, slopes[a]), (b, slopes[b]))
        case operation:
            raise AssertionError(f"{operation} is no operation of formulas")


def _of_unary(builder: Builder, function: Function, index: int, a: int, slope: int) -> int:
    match function:
        case Function.SINE:
            return builder.multiply(_times_turn(builder, slope), builder.unary(Function.COSINE, a))
        case Function.COSINE:
            sine = builder.unary(Function.SINE, a)
            return builder.negate(builder.multiply(_times_turn(builder, slope), sine))
        case Function.SQUARE_ROOT:
            return builder.shift(builder.multiply(slope, builder.reciprocal(index)), -1)
        case Function.EXPONENTIAL:
            return builder.multiply(index, slope)
        case Function.WRAP:
            return slope
        case _:
            raise AssertionError(f"{function} is no function of one number")


def _of_binary(
    builder: Builder, function: Function, index: int, a: tuple[int, int], b: tuple[int, int]
) -> int:
    """For the point (b, a) by its distance and the cosine and sine of its angle."""
    (height, rise), (width, run) = a, b
    is_distance = function is Function.HYPOTENUSE
    distance = index if is_distance else builder.binary(Function.HYPOTENUSE, width, height)
    inverse = builder.reciprocal(distance)
    sine, cosine = builder.multiply(height, inverse), builder.multiply(width, inverse)
    if is_distance:
        return builder.add(builder.multiply(sine, rise), builder.multiply(cosine, run))
    # A distance twice a factor in place of its square keeps the numbers near each other in size.
    across = builder.subtract(builder.multiply(cosine, rise), builder.multiply(sine, run))
    per_turn = builder.constant(1 / math.tau)
    return builder.multiply(per_turn, builder.multiply(across, inverse))


def _times_turn(builder: Builder, a: int) -> int:
    return builder.multiply(builder.constant(math.tau), a)
