"""From floating-point numbers to fixed-point ones, and back."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.float_structure import (
    conversion_from_fixed,
    conversion_to_fixed,
    converted_exponent_width,
    converted_width,
    levels,
)
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.errors import FormatError
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import decoded, rounded
from kalmanhdl.rtl.floating.shifting import denormalised, normalised, shifted_right
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatToFixed(wiring.Component):
    """The raw integer of a in a fixed-point format: ``arithmetic.floating.to_fixed``.

    It stands ``registers`` clocks after its operand, rounded as the floating-point format rounds; beyond the
    format's limits it is the limit, of NaN zero.

    Raises:
        FormatError: the fixed-point format ends below the least normal number.
    """

    def __init__(self, form: Float, fixed: Fixed, registers: int = 0) -> None:
        self.form, self.fixed, self.registers = form, fixed, registers
        self._top = fixed.width - fixed.signed - fixed.fraction
        if self._top + form.bias < 1:
            raise FormatError(
                f"{fixed} ends below the least normal number of {form}: use fewer fraction bits"
            )
        super().__init__({"a": In(form.width), "result": Out(fixed.width)})

    def compute(self, a: int) -> int:
        """The bits of the raw integer of an encoded number."""
        return floating.to_fixed(self.form, a, self.fixed) & ((1 << self.fixed.width) - 1)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        width = converted_width(self.form, self.fixed)
        chain = Chain(m, conversion_to_fixed(self.form, self.fixed), self.registers)
        state = chain.after_piece(self._placed(m))
        state = shifted_right(chain, state, levels(width), width)
        state = chain.after_piece(self._rounded(m, state))
        m.d.comb += self.result.eq(chain.after_piece(self._limited(m, state))["result"])
        chain.finish()
        return m

    def _placed(self, m: Module) -> dict[str, Value]:
        """The significand at the top of a register whose last bit is half of the format's last one.

        The leading bit at its top has the weight of the greatest magnitude of the format.
        """
        form, fixed = self.form, self.fixed
        width = converted_width(form, fixed)
        count, parts = levels(width), decoded(m, "a", form, self.a)
        room = max(form.exponent, count, (fixed.width + abs(fixed.fraction) + form.bias).bit_length()) + 2
        apart = (self._top + form.bias - fitted(parts.exponent, room, True))[:room]
        apart = named(m, "apart", apart.as_signed())
        return {
            "value": Cat(Const(0, width - form.mantissa - 1), parts.significand),
            "amount": apart[:count] | apart[count:-1].any().replicate(count),
            "sticky": Const(0, 1),
            "beyond": apart[-1] & ~parts.zero | parts.infinite,
            "sign": parts.sign,
            "nan": parts.nan,
        }

    def _rounded(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        value, form = state.pop("value"), self.form
        kept = self.fixed.width - self.fixed.signed + 1
        whole, rest = value[-kept:], value[:-kept]
        up: Value = Const(0, 1)
        if form.rounding is Rounding.HALF_EVEN:
            up = rest[-1] & (rest[:-1].any() | state["sticky"] | whole[0])
        magnitude = named(m, "magnitude", (whole + up)[: kept + 1])
        return {key: state[key] for key in ("beyond", "sign", "nan")} | {"magnitude": magnitude}

    def _limited(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        fixed, magnitude, sign = self.fixed, state["magnitude"], state["sign"]
        limit = named(m, "limit", Mux(sign, -fixed.lowest, fixed.highest)[: len(magnitude)])
        beyond = named(m, "leaves", state["beyond"] | (magnitude > limit))
        kept = named(m, "kept", Mux(beyond, limit, magnitude)[: len(magnitude)])
        kept = kept & ~state["nan"].replicate(len(kept))
        value = ((kept ^ sign.replicate(len(kept))) + sign)[: fixed.width]
        return {"result": named(m, "fitted", value)}


class FixedToFloat(wiring.Component):
    """The number of a raw integer in a fixed-point format: ``arithmetic.floating.from_fixed``.

    It stands ``registers`` clocks after its operand.
    """

    def __init__(self, fixed: Fixed, form: Float, registers: int = 0) -> None:
        self.fixed, self.form, self.registers = fixed, form, registers
        super().__init__({"a": In(fixed.width), "result": Out(form.width)})

    def compute(self, a: int) -> int:
        """The encoded number of the bits of a raw integer."""
        negative = self.fixed.signed and a >> (self.fixed.width - 1)
        return floating.from_fixed(self.form, a - (1 << self.fixed.width) * bool(negative), self.fixed)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form, fixed = self.form, self.fixed
        chain = Chain(m, conversion_from_fixed(form, fixed), self.registers)
        sign = self.a[-1] if fixed.signed else Const(0, 1)
        magnitude = ((self.a ^ sign.replicate(fixed.width)) + sign)[: fixed.width]
        value = named(m, "magnitude", magnitude)
        # Room for the significand and what decides its rounding.
        value = Cat(Const(0, max(form.mantissa + 3 - fixed.width, 0)), value)
        state: dict[str, Value] = {"sign": sign, "zero": ~magnitude.any(), "value": value}
        state = normalised(chain, chain.after_piece(state), levels(len(value) - 1), ("value",))
        state = chain.after_piece(self._placed(m, state))
        state = denormalised(chain, form, state)
        m.d.comb += self.result.eq(rounded(chain, form, state))
        chain.finish()
        return m

    def _placed(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        form, fixed = self.form, self.fixed
        width, value = converted_exponent_width(form, fixed), state.pop("value")
        top = fixed.width - fixed.fraction - 2 + form.bias
        below = (Const(top, width) - state.pop("value_shift"))[:width]
        significand, rest = value[-form.mantissa - 1 :], value[: -form.mantissa - 1]
        return state | {
            "below": named(m, "below", below),
            "significand": significand,
            "guard": rest[-1],
            "sticky": rest[:-1].any(),
            "infinite": Const(0, 1),
            "nan": Const(0, 1),
        }
