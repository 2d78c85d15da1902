"""Verilog adds what the hardware adds, whatever signs its wires were declared with."""

from amaranth.hdl import Module, Shape
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.toolchain.yosys import rtlil_to_verilog


class _Sum(Component):
    """An unsigned sum of numbers whose wires are signed."""

    def __init__(self) -> None:
        super().__init__({"a": In(Shape(4, True)), "b": In(Shape(1, True)), "y": Out(5)})

    def elaborate(self, platform):
        m = Module()
        m.d.comb += self.y.eq(self.a.as_unsigned() + self.b.as_unsigned())
        return m


def test_an_unsigned_sum_of_signed_wires_stays_unsigned():
    assert "signed" not in rtlil_to_verilog(to_rtlil(_Sum(), "top"), "top")
