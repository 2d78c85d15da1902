"""Matrices on wires."""

from amaranth.hdl import signed
from amaranth.lib.data import ArrayLayout

from kalmanhdl.processor.core import Core


def matrix_layout(core: Core) -> ArrayLayout:
    """The elements of a matrix, row after row, element 0 at the bottom."""
    return ArrayLayout(signed(core.form.width), core.elements)


def bank_name(core: Core, element: int) -> str:
    """The bank of an element by row and column, as the paper numbers them: 11 to 33 of a 3 by 3 matrix."""
    row, column = divmod(element, core.size)
    apart = "_" if core.size > 9 else ""
    return f"data_store_{row + 1}{apart}{column + 1}"
