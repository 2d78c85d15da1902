"""Floating-point multiplication and addition with one rounding."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import exponent_width, fused_addition, fused_width, levels
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import Parts, decoded, rounded
from kalmanhdl.rtl.floating.products import exact_product
from kalmanhdl.rtl.floating.shifting import normalised, shifted_right
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatFused(wiring.Component):
    """a * b + c: ``arithmetic.floating.fused_multiply_add``, ``registers`` clocks after its operands.

    ``minus_product``: c - a * b; ``minus_addend``: a * b - c.
    """

    def __init__(
        self,
        form: Float,
        registers: int = 0,
        on_block: bool = True,
        *,
        minus_product: bool = False,
        minus_addend: bool = False,
    ) -> None:
        self.form, self.registers, self.on_block = form, registers, on_block
        self.minus_product, self.minus_addend = minus_product, minus_addend
        self._width = exponent_width(form, fused_width(form)) + 1
        ports = {name: In(form.width) for name in ("a", "b", "c")}
        super().__init__(ports | {"result": Out(form.width)})

    def compute(self, a: int, b: int, c: int) -> int:
        """The sum of encoded numbers."""
        form = self.form
        a = floating.negate(form, a) if self.minus_product else a
        c = floating.negate(form, c) if self.minus_addend else c
        return floating.fused_multiply_add(form, a, b, c)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form = self.form
        chain = Chain(m, fused_addition(form, self.on_block), self.registers)
        a, b, c = (decoded(m, name, form, getattr(self, name)) for name in ("a", "b", "c"))
        state = self._flags(m, a, b, c) | self._exponents(m, a, b, c) | {"addend": c.significand}
        state = exact_product(chain, a.significand, b.significand, self.on_block, state, then=True)
        state = chain.after_piece(self._aligned(m, state))
        width = fused_width(form)
        state = shifted_right(chain, state, levels(width - 1), width - 1)
        state = chain.after_piece(_summed(m, state))
        state = chain.after_piece(_magnitude(m, state))
        state = normalised(chain, state, levels(width - 1), ("sum",), limited=form.subnormals)
        state = chain.after_piece(self._placed(m, state))
        m.d.comb += self.result.eq(rounded(chain, form, state))
        chain.finish()
        return m

    def _flags(self, m: Module, a: Parts, b: Parts, c: Parts) -> dict[str, Value]:
        sign = named(m, "product_sign", a.sign ^ b.sign ^ Const(self.minus_product, 1))
        other = named(m, "addend_sign", c.sign ^ Const(self.minus_addend, 1))
        infinite = named(m, "product_infinite", a.infinite | b.infinite)
        undefined = (a.infinite & b.zero) | (b.infinite & a.zero)
        opposed = infinite & c.infinite & (sign ^ other)
        return {
            "product_sign": sign,
            "addend_sign": other,
            "addend_infinite": c.infinite & ~infinite,
            "nothing": a.zero | b.zero,
            "infinite": infinite | c.infinite,
            "nan": a.nan | b.nan | c.nan | undefined | opposed,
        }

    def _exponents(self, m: Module, a: Parts, b: Parts, c: Parts) -> dict[str, Value]:
        """Less one each: of the addend, and of the place for its leading one where it is not shifted."""
        form, width = self.form, self._width
        x, y, z = (fitted(parts.exponent, width, True) for parts in (a, b, c))
        top = x + y + (form.mantissa + 3 - form.bias)
        return {
            "top": named(m, "top", top[:width].as_signed()),
            "addend_below": named(m, "addend_below", (z - 1)[:width].as_signed()),
        }

    def _aligned(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """How far the addend is to be shifted to the right.

        An addend far above the product stands two places above it: the product is nothing but sticky then.
        Where subnormals count, a product so small that it is nothing but sticky is a last bit.
        """
        form, width = self.form, fused_width(self.form)
        count = levels(width - 1)
        product, top, addend = (state.pop(key) for key in ("product", "top", "addend_below"))
        nothing = state.pop("nothing")
        low = -1
        if form.subnormals:
            low = 0
            tiny = top[-1]
            product = Mux(tiny, product.any(), product)[: len(product)]
            nothing = nothing | tiny
        top = Mux(nothing, low, top)[: self._width].as_signed()
        apart = named(m, "apart", (top - addend)[: self._width])
        beyond = apart[-1]
        amount = apart[:count] | apart[count:-1].any().replicate(count)
        return state | {
            "product": product,
            "value": Cat(Const(0, width - 1 - len(state["addend"])), state.pop("addend")),
            "amount": named(m, "amount", amount & ~beyond.replicate(count)),
            "sticky": Const(0, 1),
            "below": named(m, "below", Mux(beyond, addend, top)[: self._width]),
        }

    def _placed(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        value, below, moved = (state.pop(key) for key in ("sum", "below", "sum_shift"))
        low = len(value) - self.form.mantissa - 1
        return state | {
            "below": named(m, "placed", (below - moved)[: len(below)]),
            "significand": value[low:],
            "guard": value[low - 1],
            "sticky": value[: low - 1].any(),
        }


def _summed(m: Module, state: dict[str, Value]) -> dict[str, Value]:
    """The product and the addend, or the product less the addend, which may be negative."""
    unlike = named(m, "unlike", state["product_sign"] ^ state["addend_sign"])
    addend = Cat(state.pop("sticky"), state.pop("value"))
    width = len(addend) + 1
    product = fitted(Cat(Const(0, 3), state.pop("product")), width, False)
    addend = fitted(addend, width, False) ^ unlike.replicate(width)
    total = Cat(unlike, product) + Cat(unlike, addend)
    return state | {"sum": named(m, "total", total[1 : 1 + width])}


def _magnitude(m: Module, state: dict[str, Value]) -> dict[str, Value]:
    total = state.pop("sum")
    negative, width = total[-1], len(total) - 1
    value = (total[:width] ^ negative.replicate(width)) + negative
    value = named(m, "magnitude", value[:width])
    sign, other = state.pop("product_sign"), state.pop("addend_sign")
    zero = named(m, "cancelled", ~total.any())
    of_addend = Mux(state["infinite"], state.pop("addend_infinite"), negative)
    decided = Mux(of_addend, other, sign)
    return state | {
        "sum": value,
        "sum_room": state["below"],
        "zero": zero,
        "sign": Mux(zero & ~state["infinite"], sign & other, decided),
    }
