"""Arrays of samples as arrays of elements, and back.

Samples stand in rows (..., k); an algorithm computes with k elements, each an array over the samples.
"""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.signal import Array

Numbers = NDArray[np.float64]


def elements(rows: Numbers) -> Array:
    """(..., k) to k elements that are arrays of shape (...)."""
    result = np.empty(rows.shape[-1], object)
    for k in range(rows.shape[-1]):
        result[k] = rows[..., k]
    return result


def rows(elements: Array, shape: tuple[int, ...]) -> Numbers:
    """Elements, floats or arrays of a shape, to one array with that shape in front."""
    result = np.empty((*shape, *elements.shape))
    for place in np.ndindex(*elements.shape):
        result[(..., *place)] = elements[place]
    return result
