"""Functions for nonlinear models, on floats, arrays and the elements of an algorithm. Angles in rad."""

import math
from typing import Any

import numpy as np

from kalmanhdl.graph.functions import value_of
from kalmanhdl.graph.operations import Function
from kalmanhdl.graph.signal import Scalar, Signal

_TURN = 2 * math.pi


def sin(a: Scalar) -> Any:
    """The sine of an angle."""
    return _sine(Function.SINE, a)


def cos(a: Scalar) -> Any:
    """The cosine of an angle."""
    return _sine(Function.COSINE, a)


def sqrt(a: Scalar) -> Any:
    """The square root of a number of 0 or more."""
    return applied(Function.SQUARE_ROOT, a)


def exp(a: Scalar) -> Any:
    """The natural exponential."""
    return applied(Function.EXPONENTIAL, a)


def atan2(y: Scalar, x: Scalar) -> Any:
    """The angle of the point (x, y), from -pi to pi."""
    return _TURN * applied(Function.ARCTANGENT, y, x)


def hypot(x: Scalar, y: Scalar) -> Any:
    """sqrt(x^2 + y^2)."""
    return applied(Function.HYPOTENUSE, x, y)


def wrap(angle: Scalar) -> Any:
    """The angle less whole turns, from -pi to pi."""
    return _TURN * applied(Function.WRAP, angle * (1 / _TURN))


def _sine(function: Function, a: Scalar) -> Any:
    if isinstance(a, Signal):
        return applied(function, a * (1 / _TURN))
    # In radians as they are: one rounding less.
    return np.sin(a) if function is Function.SINE else np.cos(a)


def applied(function: Function, *arguments: Scalar) -> Any:
    """A function of a graph, angles in turns, of one or two elements."""
    signals = [each for each in arguments if isinstance(each, Signal)]
    if not signals:
        return value_of(function, *arguments)
    builder = signals[0].builder
    indices = [
        each.index if isinstance(each, Signal) else builder.constant(float(each)) for each in arguments
    ]
    if len(indices) == 1:
        return Signal(builder, builder.unary(function, indices[0]))
    return Signal(builder, builder.binary(function, indices[0], indices[1]))
