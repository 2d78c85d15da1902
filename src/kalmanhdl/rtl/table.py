"""Combinational tables."""

from collections.abc import Sequence

from amaranth.hdl import Module, Value, unsigned
from amaranth.lib.memory import Memory

from kalmanhdl.rtl.stages import named


def looked_up(m: Module, name: str, index: Value, entries: Sequence[int], width: int) -> Value:
    """The entry at an index of a table that is built from logic."""
    # As a memory it stays one look-up in simulation; synthesis sees contents that never change.
    table = Memory(shape=unsigned(width), depth=len(entries), init=entries, attrs={"rom_style": "logic"})
    port = table.read_port(domain="comb")
    m.submodules[f"{name}_table"] = table
    m.d.comb += port.addr.eq(index)
    return named(m, name, port.data)
