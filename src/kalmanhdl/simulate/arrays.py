"""The arrays of a run: checked, in the layout that the C takes, and back as the caller sees them."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.errors import DataError, FormatError
from kalmanhdl.simulate.limbs import Integers, from_limbs, to_limbs
from kalmanhdl.simulate.program import Port, Program

Named = Mapping[str, Integers]

# Arrays start on lines of the cache.
_ALIGNED = 64
_PAGE = 1 << 21


@dataclass(frozen=True, slots=True)
class Arrays:
    """The arrays of one run as the C takes them, in the order of the program's ports."""

    steps: int
    tracks: int
    inputs: list[Integers]
    flags: list[Integers]
    active: NDArray[np.uint8] | None
    state: list[Integers]


@dataclass(frozen=True, slots=True)
class Results:
    outputs: list[Integers]
    records: list[Integers]


def allocated(program: Program, arrays: Arrays, record_states: bool) -> Results:
    """Arrays for what a run gives, all in one piece of memory."""
    shape, ports = (
        (arrays.steps, arrays.tracks),
        (*program.outputs, *(program.states if record_states else ())),
    )
    sizes = [
        arrays.steps * arrays.tracks * max(port.limbs, 1) * np.dtype(port.row).itemsize for port in ports
    ]
    places = list(accumulate((-(-size // _ALIGNED) * _ALIGNED for size in sizes), initial=0))
    memory = _memory(places[-1])
    made = [
        memory[at : at + size].view(port.row).reshape((*shape, port.limbs) if port.limbs else shape)
        for port, at, size in zip(ports, places, sizes, strict=False)
    ]
    return Results(made[: len(program.outputs)], made[len(program.outputs) :])


def _memory(size: int) -> NDArray[np.uint8]:
    """Bytes in large pages, which NumPy asks for: a run takes less time than thousands of small ones."""
    if size < 2 * _PAGE:
        return np.empty(size, np.uint8)
    whole = np.empty((size // _PAGE + 2) * _PAGE, np.uint8)
    start = -whole.ctypes.data % _PAGE
    return whole[start : start + size]


def empty(port: Port, shape: tuple[int, ...]) -> Integers:
    return np.empty((*shape, port.limbs) if port.limbs else shape, port.row)


def whole(port: Port, array: Integers) -> Integers:
    """An array of the C as the caller sees it."""
    if port.flag:
        return array.view(np.bool_)
    return from_limbs(array) if port.limbs else array


def checked(
    program: Program, inputs: Named, flags: Named, active: NDArray[np.bool_] | None, initial: Named
) -> Arrays:
    named = {**inputs, **flags}
    for port in (*program.inputs, *program.flags):
        if port.name not in named:
            raise DataError(
                f"{port.name}: the step needs it, but only {', '.join(named) or 'nothing'} is given"
            )
    shapes = {name: np.shape(array) for name, array in named.items()}
    if active is not None:
        shapes["active"] = np.shape(active)
    shape = next(iter(shapes.values()), (0, 0))
    for name, other in shapes.items():
        if len(other) != 2 or other != shape:
            raise DataError(f"{name}: shape {other}, but all arrays are (steps, tracks), here {shape}")
    mask = None if active is None else np.ascontiguousarray(active, np.bool_).view(np.uint8)
    state = [_start(port, initial, shape[1]) for port in program.states]
    return Arrays(
        shape[0],
        shape[1],
        [_raw(port, np.asarray(inputs[port.name]), mask) for port in program.inputs],
        [np.ascontiguousarray(flags[port.name], np.bool_).view(np.uint8) for port in program.flags],
        mask,
        state,
    )


def _start(port: Port, initial: Named, tracks: int) -> Integers:
    given = np.asarray(initial.get(port.name, np.zeros(tracks, np.int64)))
    if given.shape != (tracks,):
        raise DataError(f"{port.name}: initial state of shape {given.shape}, but there are {tracks} tracks")
    if port.flag:
        return given.astype(np.bool_).view(np.uint8)
    return _raw(port, given, None).copy()


def _raw(port: Port, array: Integers, active: NDArray[np.uint8] | None) -> Integers:
    """An array of raw integers as limbs, after a look at every one of them."""
    if array.dtype.kind not in "iuO":
        raise DataError(f"{port.name}: raw integers are needed, but the array holds {array.dtype}")
    if active is not None:
        array = np.where(active, array, 0)
    if array.size and (array.min() < port.low or array.max() > port.high):
        place = tuple(int(i) for i in np.argwhere((array < port.low) | (array > port.high))[0])
        where = f"step {place[0]}, track {place[1]}" if len(place) == 2 else f"track {place[0]}"
        raise FormatError(
            f"{port.name}, {where}: raw {array[place]} is outside of its format, {port.low} to {port.high}"
        )
    if port.limbs:
        return to_limbs(array, port.limbs)
    return np.ascontiguousarray(array, port.row)
