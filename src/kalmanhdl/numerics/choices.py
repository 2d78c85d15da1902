"""Formats and methods as a user may write them, the same in Python and in a design file.

Every function takes what was written, gives the value that it stands for, and raises ValueError with the
rest of a message that begins with the key.
"""

import re
from collections.abc import Mapping
from typing import Literal

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.numerics.functions.method import Cordic, FunctionMethod, Interpolation
from kalmanhdl.validation import as_flag, as_integer, as_real, as_tuple, nearest, shown

MAX_WIDTH = 1024
MAX_FRACTION = 4096
MAX_INDEX_BITS = 16
MAX_FUNCTION_INDEX_BITS = 12
MAX_ITERATIONS = 8

AUTO: Literal["auto"] = "auto"
DIVISIONS = {"radix2": LongDivision(radix=2), "radix4": LongDivision(radix=4)}
FUNCTIONS: dict[str, FunctionMethod | None] = {AUTO: None, "cordic": Cordic()}

_Q_FORMAT = re.compile(r"(U?)Q(-?\d{1,5})\.(-?\d{1,5})\Z")
_FORMAT_KEYS = ("width", "fraction", "signed")
_FORMAT_RULE = 'write a width like 16, a format like "Q12.20", or { width = 20, fraction = 4, signed = true }'

Form = int | Fixed
"""A width, whose binary point the range analysis places, or a whole format."""


def parse_format(text: str) -> Fixed | None:
    """``"Q12.20"``: 12 integer bits, sign included, and 20 fraction bits; ``"UQ12.20"`` is unsigned."""
    match = _Q_FORMAT.match(text)
    if match is None:
        return None
    integer, fraction = int(match[2]), int(match[3])
    if not 1 <= integer + fraction <= MAX_WIDTH:
        return None
    return Fixed(width=integer + fraction, fraction=fraction, signed=not match[1])


def as_width(written: object) -> int:
    """A width in bits."""
    width = as_integer(written)
    if width is None or not 1 <= width <= MAX_WIDTH:
        raise ValueError(f" = {shown(written)}: a width is an integer from 1 to {MAX_WIDTH}")
    return width


def as_form(written: object) -> Form:
    """A width, or a format: a ``Fixed``, its word, or a table of its sizes."""
    if isinstance(written, Mapping):
        return _form_of_table(written)
    if isinstance(written, str):
        form = parse_format(written)
        if form is None:
            raise ValueError(f": {shown(written)} is no format: {_FORMAT_RULE}")
        return form
    if not isinstance(written, Fixed):
        return as_width(written)
    as_width(written.width)
    if abs(written.fraction) > MAX_FRACTION:
        problem = f"a fraction is an integer from -{MAX_FRACTION} to {MAX_FRACTION}"
        raise ValueError(f" = {written}: {problem}")
    return written


def _form_of_table(table: Mapping[object, object]) -> Fixed:
    for key in table:
        if key not in _FORMAT_KEYS:
            raise ValueError(f": {shown(key)} is no key of a format: {nearest(str(key), _FORMAT_KEYS)}")
    width, fraction = as_integer(table.get("width")), as_integer(table.get("fraction"))
    signed = as_flag(table.get("signed", True))
    if width is None or fraction is None or signed is None:
        raise ValueError(f": {shown(table)} is no format: {_FORMAT_RULE}")
    if not 1 <= width <= MAX_WIDTH or abs(fraction) > MAX_FRACTION:
        limits = f"a width is 1 to {MAX_WIDTH}, a fraction -{MAX_FRACTION} to {MAX_FRACTION}"
        raise ValueError(f": {shown(table)} is no format: {limits}")
    return Fixed(width=width, fraction=fraction, signed=signed)


def as_scales(written: object) -> Literal["auto"] | tuple[float, ...]:
    """The unit of each state, or "auto"."""
    scale = as_scale(written)
    if isinstance(scale, float):
        raise ValueError(f': {shown(scale)} is no list: write "auto" or one number a state')
    return scale


def as_scale(written: object) -> Literal["auto"] | float | tuple[float, ...]:
    """A unit for all states or one for each, or "auto"."""
    if isinstance(written, str) and written == AUTO:
        return AUTO
    entries = as_tuple(written)
    return _positive(written) if entries is None else tuple(map(_positive, entries))


def _positive(written: object) -> float:
    number = as_real(written)
    if number is None or not 0 < number < float("inf"):
        raise ValueError(f' = {shown(written)}: a scale is a positive number, or "auto"')
    return number


def as_division(written: object) -> DivisionMethod:
    """How to divide: a word, a table of sizes, or the method itself."""
    if isinstance(written, str) and written in DIVISIONS:
        return DIVISIONS[written]
    if isinstance(written, LongDivision):
        radix = as_integer(written.radix)
        if radix not in (2, 4):
            raise ValueError(f" radix {shown(written.radix)}: radix 2 or 4")
        return LongDivision(radix=radix)
    if isinstance(written, Mapping) and "table" in written and set(written) <= {"table", "newton"}:
        written = TableNewton(index_bits=written["table"], iterations=written.get("newton", 0))
    if not isinstance(written, TableNewton):
        raise ValueError(f' = {shown(written)}: write "radix2", "radix4" or {{ table = 10, newton = 0 }}')
    iterations = as_integer(written.iterations)
    if iterations is None or not 0 <= iterations <= MAX_ITERATIONS:
        raise ValueError(f" newton = {shown(written.iterations)}: 0 to {MAX_ITERATIONS} iterations")
    return TableNewton(index_bits=_index_bits(written.index_bits, MAX_INDEX_BITS), iterations=iterations)


def as_functions(written: object) -> FunctionMethod | None:
    """How to compute sines and the like: a word, a table of sizes, or the method itself; None for "auto"."""
    if isinstance(written, str) and written in FUNCTIONS:
        return FUNCTIONS[written]
    if written is None or isinstance(written, Cordic):
        return written
    if isinstance(written, Mapping) and set(written) == {"table"}:
        written = Interpolation(index_bits=written["table"])
    if not isinstance(written, Interpolation):
        raise ValueError(f' = {shown(written)}: write "auto", "cordic" or {{ table = 8 }}')
    return Interpolation(index_bits=_index_bits(written.index_bits, MAX_FUNCTION_INDEX_BITS))


def _index_bits(written: object, most: int) -> int:
    bits = as_integer(written)
    if bits is None or not 1 <= bits <= most:
        raise ValueError(f" table = {shown(written)}: an index has 1 to {most} bits")
    return bits
