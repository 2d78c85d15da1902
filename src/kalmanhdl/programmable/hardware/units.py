"""The units that compute exactly, each in a clock."""

from amaranth.hdl import Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.programmable.operations import AddFunction
from kalmanhdl.shape import Shape


class Adder(wiring.Component):
    """What ``AddFunction`` says, exact, a clock after its operands."""

    def __init__(self, shape: Shape) -> None:
        super().__init__(
            {
                "a": In(signed(shape.word_width)),
                "b": In(signed(shape.word_width)),
                "c": In(1),
                "function": In(2),
                "raw": Out(signed(shape.word_width + 1)),
            }
        )

    def compute(self, function: AddFunction, a: int, b: int, c: int) -> int:
        """The exact result."""
        match function:
            case AddFunction.ADD:
                return a + b
            case AddFunction.SUBTRACT:
                return a - b
            case AddFunction.SELECT:
                return a if c else b
            case AddFunction.NEGATIVE:
                return int(a < 0)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        raw = Signal(self.raw.shape(), reset_less=True)
        minus = self.function == AddFunction.SUBTRACT
        # One chain of carries for both: a - b is a + ~b + 1.
        total = self.a + Mux(minus, ~self.b, self.b) + minus
        with m.Switch(self.function):
            with m.Case(AddFunction.SELECT):
                m.d.sync += raw.eq(Mux(self.c, self.a, self.b))
            with m.Case(AddFunction.NEGATIVE):
                m.d.sync += raw.eq(self.a[-1])
            with m.Default():
                m.d.sync += raw.eq(total)
        m.d.comb += self.raw.eq(raw)
        return m
