"""Floating-point multiplication."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import exponent_width, levels, multiplication
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import Parts, decoded, rounded
from kalmanhdl.rtl.floating.products import exact_product
from kalmanhdl.rtl.floating.shifting import shifted_right
from kalmanhdl.rtl.leading_one import leading_zeros
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatMultiplier(wiring.Component):
    """a * b: ``arithmetic.floating.multiply``, ``registers`` clocks after its operands.

    ``on_block``: the significands are multiplied on multiplier blocks. Where subnormals count, how far the
    product is to be moved, in either direction, is found beside the product.
    """

    def __init__(self, form: Float, registers: int = 0, on_block: bool = True) -> None:
        self.form, self.registers, self.on_block = form, registers, on_block
        self._width = exponent_width(form, form.mantissa)
        super().__init__({"a": In(form.width), "b": In(form.width), "result": Out(form.width)})

    def compute(self, a: int, b: int) -> int:
        """The product of encoded numbers."""
        return floating.multiply(self.form, a, b)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form = self.form
        chain = Chain(m, multiplication(form, self.on_block), self.registers)
        a, b = decoded(m, "a", form, self.a), decoded(m, "b", form, self.b)
        state = self._multiplied(m, chain, a, b)
        if form.subnormals:
            state = chain.after_piece(self._counted(m, state))
            state = shifted_right(chain, state, levels(2 * form.mantissa + 3), form.mantissa + 3)
        else:
            state = chain.after_piece(state)
            product = state.pop("product")
            low = form.mantissa - 1
            state |= {"value": product[low:], "sticky": product[:low].any(), "room": Const(1, 1)}
        state = chain.after_piece(self._placed(m, state))
        m.d.comb += self.result.eq(rounded(chain, form, state))
        chain.finish()
        return m

    def _multiplied(self, m: Module, chain: Chain, a: Parts, b: Parts) -> dict[str, Value]:
        """The product, and beside it the exponent of its top bit and what else is known."""
        form = self.form
        exponent = fitted(a.exponent, self._width, True) + fitted(b.exponent, self._width, True)
        state = {
            "below": named(m, "below_sum", (exponent - form.bias)[: self._width].as_signed()),
            "sign": a.sign ^ b.sign,
            "zero": a.zero | b.zero,
            "infinite": a.infinite | b.infinite,
            "nan": a.nan | b.nan | (a.infinite & b.zero) | (b.infinite & a.zero),
        }
        if form.subnormals:
            state["zeros"] = named(m, "zeros", leading_zeros(_subnormal_bits(m, a, b)))
        significands = a.significand, b.significand
        return exact_product(chain, *significands, self.on_block, state, then=form.subnormals)

    def _counted(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """Where the product is to be moved to so that its leading one, or its exponent 1, is at the top.

        A product with its last bits where the top is to be is shifted right: by the mantissa less the zeros
        above the leading one, but by so much more that no exponent is below 1.
        """
        form = self.form
        count = levels(2 * form.mantissa + 3)
        width = max(self._width, count) + 2
        below, zeros = fitted(state["below"], width, True), fitted(state["zeros"], width, True)
        spare = named(m, "spare", (below - zeros)[:width].as_signed())
        amount = Mux(spare < 0, form.mantissa - below, form.mantissa - zeros)[:width]
        amount = named(m, "amount", amount)
        kept = {key: state[key] for key in ("sign", "zero", "infinite", "nan")}
        return kept | {
            "value": Cat(Const(0, 1), state["product"]),
            "amount": amount[:count] | amount[count:].any().replicate(count),
            "sticky": Const(0, 1),
            "below": named(m, "below", spare[: self._width] & ~spare[-1].replicate(self._width)),
            "room": ~spare[-1] & spare.any(),
        }

    def _placed(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """The product moved by its last place: it has one zero above its leading one, or none."""
        value, below = state.pop("value"), state.pop("below")
        moves = named(m, "moves", ~value[-1] & state.pop("room"))
        value = Mux(moves, Cat(Const(0, 1), value[:-1]), value)[: len(value)]
        value = named(m, "moved", value)
        return state | {
            "below": named(m, "placed", (below - moves)[: len(below)]),
            "significand": value[2:],
            "guard": value[1],
            "sticky": state["sticky"] | value[0],
        }


def _subnormal_bits(m: Module, a: Parts, b: Parts) -> Value:
    """The bits of the operand that is subnormal; a leading one where none is.

    Where both are, the product is nothing but sticky, or has the exponent 1, wherever its leading one is.
    """
    width = len(a.significand)
    low = a.significand & ~a.normal.replicate(width) | b.significand & ~b.normal.replicate(width)
    return Cat(low[: width - 1], a.normal & b.normal)
