"""Arrays of Python integers as arrays of 64-bit limbs, and back."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

# int64, objects (Python integers), limbs or the bytes of flags.
Integers = NDArray[Any]
_MASK = (1 << 64) - 1


def to_limbs(values: Integers, limbs: int) -> NDArray[np.uint64]:
    """Integers in two's complement, least significant limb first, on a new last axis."""
    whole = np.asarray(values, dtype=object)
    parts = [np.asarray((whole >> 64 * i) & _MASK).astype(np.uint64) for i in range(limbs)]
    return np.ascontiguousarray(np.stack(parts, axis=-1))


def from_limbs(parts: NDArray[np.uint64]) -> Integers:
    """The integers of an array of limbs (last axis), as Python integers."""
    limbs = parts.shape[-1]
    total = np.asarray(parts[..., limbs - 1]).astype(np.int64).astype(object)
    for i in reversed(range(limbs - 1)):
        total = (total << 64) | np.asarray(parts[..., i]).astype(object)
    return np.asarray(total, dtype=object)
