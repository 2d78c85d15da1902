"""The arrays of a run: checked, in the layout that the C takes, and back as the caller sees them."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.errors import DataError, FormatError
from kalmanhdl.numerics.typed import Interval
from kalmanhdl.simulate.limbs import Integers, from_limbs, to_limbs
from kalmanhdl.simulate.program import Port, Program

Named = Mapping[str, Integers]

# Arrays start on lines of the cache.
_ALIGNED = 64
_PAGE = 1 << 21


@dataclass(frozen=True, slots=True)
class Arrays:
    """The arrays of one run as the C takes them, in the order of the program's ports.

    ``wide`` tells for each input whether its integers come in 64 bits, not yet looked at.
    """

    steps: int
    tracks: int
    inputs: list[Integers]
    wide: list[bool]
    flags: list[Integers]
    active: NDArray[np.uint8] | None
    state: list[Integers]


@dataclass(frozen=True, slots=True)
class Results:
    """The arrays of what a run gives; ``addresses`` are those of all outputs, then of all records."""

    outputs: list[Integers]
    records: list[Integers]
    addresses: list[int]


def allocated(program: Program, arrays: Arrays, record_states: bool) -> Results:
    """Arrays for what a run gives, all in one piece of memory."""
    shape, ports = (
        (arrays.steps, arrays.tracks),
        (*program.outputs, *(program.states if record_states else ())),
    )
    number = arrays.steps * arrays.tracks
    places = list(accumulate((-(-number * p.size // _ALIGNED) * _ALIGNED for p in ports), initial=0))
    memory = _memory(places[-1])
    made = [
        np.ndarray((*shape, port.limbs) if port.limbs else shape, port.row, memory, at)
        for port, at in zip(ports, places, strict=False)
    ]
    begin, outputs = memory.ctypes.data, len(program.outputs)
    return Results(made[:outputs], made[outputs:], [begin + place for place in places[:-1]])


def _memory(size: int) -> NDArray[np.uint8]:
    """Bytes in large pages, which NumPy asks for: a run takes less time than thousands of small ones."""
    if size < 2 * _PAGE:
        return np.empty(size, np.uint8)
    whole = np.empty((size // _PAGE + 2) * _PAGE, np.uint8)
    start = -whole.ctypes.data % _PAGE
    return whole[start : start + size]


class Extremes:
    """The memory for what a run's watched values took, for each lane; see ``assembly``."""

    def __init__(self, program: Program, lanes: int) -> None:
        self.ports = program.watched
        self.narrow = np.empty((2, len(self.ports), lanes), np.int64)
        self.long = {
            (end, k): np.empty((lanes, port.limbs), np.uint64)
            for end in range(2)
            for k, port in enumerate(self.ports)
            if port.limbs
        }

    @property
    def addresses(self) -> list[int]:
        """Where the C writes: all least values, then all greatest ones."""
        begin, row = self.narrow.ctypes.data, self.narrow.strides[1]
        found = [begin + row * k for k in range(2 * len(self.ports))]
        for (end, k), array in self.long.items():
            found[end * len(self.ports) + k] = array.ctypes.data
        return found

    def seen(self) -> dict[int, Interval]:
        """What each watched operation took."""
        lows, highs = self.narrow[0].min(axis=1).tolist(), self.narrow[1].max(axis=1).tolist()
        for (end, k), array in self.long.items():
            values = from_limbs(array)
            (lows, highs)[end][k] = int((values.min, values.max)[end]())
        return {
            port.index: Interval(low=low, high=high)
            for port, low, high in zip(self.ports, lows, highs, strict=True)
        }


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
    given = [_given(port, np.asarray(inputs[port.name]), mask) for port in program.inputs]
    return Arrays(
        shape[0],
        shape[1],
        [array for array, _ in given],
        [wide for _, wide in given],
        [np.ascontiguousarray(flags[port.name], np.bool_).view(np.uint8) for port in program.flags],
        mask,
        state,
    )


def _start(port: Port, initial: Named, tracks: int) -> Integers:
    if port.name not in initial:
        return np.zeros((tracks, port.limbs) if port.limbs else tracks, port.row)
    given = np.asarray(initial[port.name])
    if given.shape != (tracks,):
        raise DataError(f"{port.name}: initial state of shape {given.shape}, but there are {tracks} tracks")
    if port.flag:
        return given.astype(np.bool_).view(np.uint8)
    return _raw(port, given, None).copy()


def _given(port: Port, array: Integers, active: NDArray[np.uint8] | None) -> tuple[Integers, bool]:
    """An input as the C takes it, and whether in 64 bits."""
    if port.narrows and array.dtype == np.int64:
        return np.ascontiguousarray(array), True
    return _raw(port, array, active), False


def _raw(port: Port, array: Integers, active: NDArray[np.uint8] | None) -> Integers:
    """An array of raw integers as rows of the C, after a look at every one of them."""
    if array.dtype.kind not in "iuO":
        raise DataError(f"{port.name}: raw integers are needed, but the array holds {array.dtype}")
    if active is not None:
        array = np.where(active, array, 0)
    _look_at(port, array)
    if port.limbs:
        return to_limbs(array, port.limbs)
    return np.ascontiguousarray(array, port.row)


def look_at_wide(program: Program, arrays: Arrays) -> None:
    """Raises FormatError for the first input of 64 bits that is outside of its format."""
    for port, array, wide in zip(program.inputs, arrays.inputs, arrays.wide, strict=True):
        if wide:
            _look_at(port, array if arrays.active is None else np.where(arrays.active, array, 0))


def _look_at(port: Port, array: Integers) -> None:
    """Raises FormatError for the first integer that is outside of the port's format."""
    if (
        array.dtype.kind != "O"
        and port.low <= np.iinfo(array.dtype).min <= np.iinfo(array.dtype).max <= port.high
    ):
        return
    if array.size and (array.min() < port.low or array.max() > port.high):
        place = tuple(int(i) for i in np.argwhere((array < port.low) | (array > port.high))[0])
        where = f"step {place[0]}, track {place[1]}" if len(place) == 2 else f"track {place[0]}"
        raise FormatError(
            f"{port.name}, {where}: raw {array[place]} is outside of its format, {port.low} to {port.high}"
        )
