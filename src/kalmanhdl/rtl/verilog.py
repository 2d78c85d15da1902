"""From a component to text: RTLIL for Yosys, and the header of the Verilog."""

from amaranth.back import rtlil
from amaranth.lib.wiring import Component


def to_rtlil(component: Component, name: str) -> str:
    """The RTLIL text of a component, its top module called ``name``. No source paths are in it."""
    return str(rtlil.convert(component, name=name, emit_src=False))
