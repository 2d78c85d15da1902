"""What a floating-point number is above its nearest whole number."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import exponent_width, levels, wrapping
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import decoded, rounded
from kalmanhdl.rtl.floating.shifting import normalised
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatWrapper(wiring.Component):
    """a less the nearest whole number: ``arithmetic.floating.wrap``, ``registers`` clocks after its operand.

    The bits above the binary point are shifted out. Half or more of what is left is less than the next whole
    number by the rest of one. Numbers below a half stay.
    """

    def __init__(self, form: Float, registers: int = 0) -> None:
        self.form, self.registers = form, registers
        super().__init__({"a": In(form.width), "result": Out(form.width)})

    def compute(self, a: int) -> int:
        """The encoded number, wrapped."""
        return floating.wrap(self.form, a)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form = self.form
        chain = Chain(m, wrapping(form), self.registers)
        state = chain.after_piece(self._placed(m))
        state = _shifted_left(chain, state, levels(form.mantissa + 1))
        state = chain.after_piece(self._turned(m, state))
        state = normalised(chain, state, levels(form.mantissa), ("value",), limited=form.subnormals)
        width = exponent_width(form, form.mantissa + 1)
        below = fitted(state.pop("before"), width, True) - state.pop("value_shift")
        value = state.pop("value")
        state = chain.after_piece(
            state
            | {
                "below": named(m, "below", below[:width]),
                "significand": value,
                "guard": Const(0, 1),
                "sticky": Const(0, 1),
                "infinite": Const(0, 1),
            }
        )
        m.d.comb += self.result.eq(rounded(chain, form, state))
        chain.finish()
        return m

    def _placed(self, m: Module) -> dict[str, Value]:
        """How many bits stand above the binary point; the exponent of the leading bit, less one."""
        form = self.form
        parts = decoded(m, "a", form, self.a)
        width = max(form.exponent, levels(form.mantissa + 1)) + 2
        above = fitted(parts.exponent, width, True) - (form.bias - 1)
        above = named(m, "above", above[:width].as_signed())
        small, count = above[-1], levels(form.mantissa + 1)
        # Beyond the last bit everything falls out, how far ever.
        amount = above[:count] | above[count:-1].any().replicate(count)
        before = Mux(small, (parts.exponent - 1)[: form.exponent], max(form.bias - 2, 0))
        return {
            "value": parts.significand,
            "amount": named(m, "amount", amount & ~small.replicate(count)),
            "before": fitted(before, width, True),
            "small": small,
            "sign": parts.sign,
            "nan": parts.nan | parts.infinite,
        }

    def _turned(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """The distance to the next whole number where it is half of one or less."""
        form, value, small = self.form, state["value"], state.pop("small")
        half = named(m, "half", value[-1] & ~small)
        tie = named(m, "tie", half & ~value[:-1].any())
        rest = ((value ^ half.replicate(len(value))) + half)[: len(value)]
        if form.bias == 1:
            # Where one is the least normal number a half is subnormal: no leading one stands that high.
            rest = Cat(rest[1:], Const(0, 1))
        rest = named(m, "rest", rest)
        zero = named(m, "nothing", ~value.any())
        room = {"value_room": state["before"][:-1]} if form.subnormals else {}
        sign = (state["sign"] ^ half | tie) & ~zero
        return {**state, **room, "value": rest, "sign": sign, "zero": zero}


def _shifted_left(chain: Chain, state: dict[str, Value], count: int) -> dict[str, Value]:
    """``value`` shifted left by ``amount``, within its width."""
    state = dict(state)
    amount = state.pop("amount")
    for level in reversed(range(count)):
        value, places = state["value"], 1 << level
        moved = Cat(Const(0, min(places, len(value))), value)[: len(value)]
        state["value"] = named(chain.module, f"left_{level}", Mux(amount[level], moved, value)[: len(value)])
        state = chain.after_piece(state | {"amount": amount})
        amount = state.pop("amount")
    return state
