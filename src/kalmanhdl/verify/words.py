"""Raw integers as the 64-bit words of ports, and back."""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.simulate.limbs import Integers, from_limbs, to_limbs

Words = NDArray[np.uint64]


def words_of(values: Integers, width: int) -> Words:
    """The words of a port, one row a value, low word first; of values too wide for it its low bits."""
    count = -(-width // 64)
    if count == 1 and values.dtype.kind != "O":
        words = values.astype(np.uint64)[:, None]
    else:
        words = to_limbs(values, count)
    words[:, -1] &= np.uint64((1 << (width - 1) % 64 + 1) - 1)
    return words


def values_of(words: Words, width: int, form: Fixed | Float | None) -> Integers:
    """The raw integers that a port's words stand for; ``form`` says whether they have a sign."""
    signed = isinstance(form, Fixed) and form.signed
    if width > 64:
        raws = from_limbs(words) & ((1 << width) - 1)
        return np.asarray(raws - ((raws >> (width - 1)) << width)) if signed else np.asarray(raws)
    if not signed:
        return words[:, 0]
    unused = np.uint64(64 - width)
    return np.asarray((words[:, 0] << unused).view(np.int64) >> unused.astype(np.int64))


def columns(words: Words, ports: tuple[tuple[str, int], ...]) -> dict[str, Words]:
    """The words of each port (name, width) by name."""
    found, place = {}, 0
    for name, width in ports:
        count = -(-width // 64)
        found[name] = words[:, place : place + count]
        place += count
    return found
