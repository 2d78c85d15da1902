"""How a program reads its constants: element by element, or all elements of a matrix in a loop."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kalmanhdl.processor.compiler.evaluate import padded, raw_constant
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core

TURN = "turn"
"""The matrix that takes every row one place on and the last one to the first; loops need it."""

_LOOP_WORDS = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A constant, and the elements that are read of it, in order. ``looped``: all of them, in a loop."""

    name: str
    elements: tuple[int, ...]
    looped: bool = False


def readings(filter_: Traced, core: Core) -> tuple[Reading, ...]:
    """How the constants of a filter are read with the fewest words of program."""
    single = [
        Reading(name=name, elements=tuple(np.flatnonzero(padded(array, core.size)).tolist()))
        for name, array in filter_.constants.items()
    ]
    each, whole = _words_of_an_input(core), _all_elements(core.size)
    # What is read whole needs no instruction that clears it.
    loop = _LOOP_WORDS + each - 2
    long = {one.name for one in single if len(one.elements) * each > loop}
    saved = sum(len(one.elements) * each - loop for one in single if one.name in long)
    # One must be a number of the core, so that turning changes nothing.
    if saved <= core.size * each or 0 not in core.numbers.exponents:
        return tuple(single)
    turn = tuple(np.flatnonzero(turning(core.size)).tolist())
    return (
        Reading(name=TURN, elements=turn),
        *(Reading(name=one.name, elements=whole, looped=True) if one.name in long else one for one in single),
    )


def turning(size: int) -> np.typing.NDArray[np.float64]:
    """The matrix called TURN."""
    return np.roll(np.eye(size), 1, axis=0)


def _all_elements(size: int) -> tuple[int, ...]:
    """The elements in the order in which they come by, when element 0 is read and everything turns."""
    places = [-k % size for k in range(size)]
    return tuple(size * row + column for column in places for row in places)


def _words_of_an_input(core: Core) -> int:
    return 1 if core.pipelined else 2


def cleared_source(names: Sequence[str], core: Core) -> Iterator[str]:
    """The lines of the program that make matrices zero, whatever they were.

    What is infinite or NaN is not zero less itself: the first number that a program of floats reads is zero.
    """
    if not core.floating:
        yield from (f"{'':16}SUB_33   {name} {name} {name}" for name in names)
        return
    first, *others = names
    yield from input_lines("read_zero", 0, first, core)
    for place in range(1, core.size):
        yield f"{'':16}PLACE    {first} {place * (core.size + 1)} {first}"
    yield f"{'':16}MASK_33  {first} {first} {first}"
    yield from (f"{'':16}COPY     {first} {name}" for name in others)


def read_source(readings: Sequence[Reading], places: dict[str, str], core: Core) -> Iterator[str]:
    """The lines of the program that clear what is not read whole and read the constants.

    ``places`` are the names of matrices in the store by those of constants.
    """
    for one in readings:
        yield f"{'':16}-- {one.name}"
        place = places.get(one.name, one.name)
        if one.looped:
            yield from _loop(one.name, place, places[TURN], core)
        else:
            for element in one.elements:
                yield from input_lines(f"read_{one.name}_{element}", element, place, core)


def input_lines(label: str, element: int, name: str, core: Core) -> Iterator[str]:
    """A READ. That of a pipelined core waits by itself."""
    if core.pipelined:
        yield f"{'':16}READ     {element} {name}"
    else:
        yield f"{label + ':':<15} JUMP_DRDY {label}"
        yield f"{'':16}READ     {element} {name}"


def _loop(name: str, place: str, turn: str, core: Core) -> Iterator[str]:
    column, row = f"read_{name}_column", f"read_{name}_row"
    yield f"{'':16}LOOP     {core.size}"
    yield f"{column + ':':<15} LOOP     {core.size}"
    if core.pipelined:
        yield f"{row + ':':<15} READ     0 {place}"
    else:
        yield from input_lines(row, 0, place, core)
    yield f"{'':16}MULT_33  {turn} {place} {place}"
    yield f"{'':16}NEXT     {row}"
    yield f"{'':16}MULT_33T {place} {turn} {place}"
    yield f"{'':16}NEXT     {column}"


def numbers_read(filter_: Traced, core: Core) -> tuple[int, ...]:
    """The raw numbers that the program reads before the first row: a zero for floats, and the constants.

    Raises ProgramError for what is no number of the core.
    """
    found: list[int] = [0] if core.floating else []
    for one in readings(filter_, core):
        values = turning(core.size) if one.name == TURN else filter_.constants[one.name]
        raws = raw_constant(one.name, values, core)
        found += [raws[element] for element in one.elements]
    return tuple(found)
