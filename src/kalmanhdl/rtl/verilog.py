"""From a component to text: RTLIL for Yosys, and the header of the Verilog."""

import re

from amaranth.back import rtlil
from amaranth.lib.wiring import Component

# Cells say how they read their operands. Yosys repeats the wires' own sign in Verilog, where two signed
# operands make an unsigned addition a signed one: with the sign left off, its Verilog means the cells.
_SIGN_OF_WIRE = re.compile(r"^(\s*wire [^\\$]*)signed (?=[\\$])", re.MULTILINE)


def to_rtlil(component: Component, name: str) -> str:
    """The RTLIL text of a component, its top module called ``name``. No source paths are in it."""
    return _SIGN_OF_WIRE.sub(r"\1", str(rtlil.convert(component, name=name, emit_src=False)))
