"""The functions of a graph on floats and on arrays over samples."""

from typing import Any

import numpy as np

from kalmanhdl.graph.operations import Function


def value_of(function: Function, a: Any, b: Any = 0.0) -> Any:
    """The value of a function of reals; angles are in turns."""
    match function:
        case Function.SINE:
            return np.sin(_radians(a))
        case Function.COSINE:
            return np.cos(_radians(a))
        case Function.SQUARE_ROOT:
            return np.sqrt(a)
        case Function.EXPONENTIAL:
            return np.exp(a)
        case Function.WRAP:
            return a - np.floor(np.asarray(a) + 0.5)
        case Function.ARCTANGENT:
            return np.arctan2(a, b) / (2 * np.pi)
        case Function.HYPOTENUSE:
            return np.hypot(a, b)


def _radians(turns: Any) -> Any:
    return 2 * np.pi * np.asarray(turns)
