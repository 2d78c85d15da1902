"""Combinational tables."""

from collections.abc import Sequence

from amaranth.hdl import Cat, Const, Module, Value

from kalmanhdl.rtl.stages import named


def looked_up(m: Module, name: str, index: Value, entries: Sequence[int], width: int) -> Value:
    """The entry at an index, from logic: one selection among constants for every bit of it."""
    columns = [
        Const(sum(((entry >> bit) & 1) << place for place, entry in enumerate(entries)), len(entries))
        for bit in range(width)
    ]
    return named(m, name, Cat(*(column.bit_select(index, 1) for column in columns)))
