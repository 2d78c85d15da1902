"""Floating-point multiplication by a power of two."""

from amaranth.hdl import Const, Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import exponent_width, levels, scaling
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import decoded, rounded
from kalmanhdl.rtl.floating.shifting import denormalised, normalised
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatScaler(wiring.Component):
    """a * 2**exponent: ``arithmetic.floating.scale``, ``registers`` clocks after its operand."""

    def __init__(self, form: Float, exponent: int, registers: int = 0) -> None:
        self.form, self.exponent, self.registers = form, exponent, registers
        super().__init__({"a": In(form.width), "result": Out(form.width)})

    def compute(self, a: int) -> int:
        """The encoded number, scaled."""
        return floating.scale(self.form, a, self.exponent)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form = self.form
        chain = Chain(m, scaling(form, self.exponent), self.registers)
        a = decoded(m, "a", form, self.a)
        state: dict[str, Value] = {
            "a": a.significand,
            "a_exponent": a.exponent,
            "sign": a.sign,
            "zero": a.zero,
            "infinite": a.infinite,
            "nan": a.nan,
        }
        if form.subnormals and self.exponent > 0:
            state["a_room"] = Const(self.exponent)
            state = normalised(chain, state, levels(form.mantissa), ("a",), limited=True)
        state = chain.after_piece(self._placed(m, state))
        if self.exponent < 0:
            state = denormalised(chain, form, state)
        m.d.comb += self.result.eq(rounded(chain, form, state))
        chain.finish()
        return m

    def _placed(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        width = exponent_width(self.form, abs(self.exponent) + self.form.mantissa)
        exponent = fitted(state.pop("a_exponent"), width, True) - state.pop("a_shift", Const(0, 1))
        below = named(m, "below", (exponent + (self.exponent - 1))[:width])
        return state | {
            "below": below,
            "significand": state.pop("a"),
            "guard": Const(0, 1),
            "sticky": Const(0, 1),
        }
