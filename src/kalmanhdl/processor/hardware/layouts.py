"""Words and matrices on wires."""

from amaranth.hdl import Module, Shape, Value, signed, unsigned
from amaranth.lib.data import ArrayLayout

from kalmanhdl.processor.core import Core
from kalmanhdl.rtl.floating.encoding import canonical


def word_shape(core: Core) -> Shape:
    """A number of a core."""
    return unsigned(core.form.width) if core.floating else signed(core.form.width)


def matrix_layout(core: Core) -> ArrayLayout:
    """The elements of a matrix, row after row, element 0 at the bottom."""
    return ArrayLayout(word_shape(core), core.elements)


def is_nonzero(core: Core, number: Value) -> Value:
    """Whether a number is not zero; a zero of floating point may have a sign."""
    return number[:-1].any() if core.floating else number != 0


def taken(m: Module, core: Core, raw: Value) -> Value:
    """A number of the input as READ keeps it."""
    return canonical(m, "data_in", core.float_form, raw) if core.floating else raw


def bank_name(core: Core, element: int) -> str:
    """The bank of an element by row and column, as the paper numbers them: 11 to 33 of a 3 by 3 matrix."""
    row, column = divmod(element, core.size)
    apart = "_" if core.size > 9 else ""
    return f"data_store_{row + 1}{apart}{column + 1}"
