"""Floating-point addition and subtraction."""

from amaranth.hdl import Cat, Const, Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import addition, exponent_width, levels, sum_width
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import chosen, decoded, rounded
from kalmanhdl.rtl.floating.shifting import normalised, shifted_right
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatAdder(wiring.Component):
    """a + b, or a - b: ``arithmetic.floating.add`` or ``subtract``, ``registers`` clocks after its operands.

    One path: the smaller number is aligned with the larger one, the sum is normalised and rounded.
    """

    def __init__(self, form: Float, registers: int = 0, difference: bool = False) -> None:
        self.form, self.registers, self.difference = form, registers, difference
        super().__init__({"a": In(form.width), "b": In(form.width), "result": Out(form.width)})

    def compute(self, a: int, b: int) -> int:
        """The sum of encoded numbers."""
        return (floating.subtract if self.difference else floating.add)(self.form, a, b)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form = self.form
        chain = Chain(m, addition(form), self.registers)
        state = chain.after_piece(self._ordered(m))
        state = chain.after_piece(self._chosen(m, state))
        state = shifted_right(chain, state, levels(form.mantissa + 3), form.mantissa + 3)
        state = chain.after_piece(_summed(m, state))
        state["zero"] = named(m, "cancelled", ~state["sum"].any())
        state = normalised(chain, state, levels(sum_width(form) - 1), ("sum",), limited=form.subnormals)
        state = chain.after_piece(self._placed(m, state))
        m.d.comb += self.result.eq(rounded(chain, form, state))
        chain.finish()
        return m

    def _ordered(self, m: Module) -> dict[str, Value]:
        """Which number has the smaller magnitude, and by how much the exponents differ either way."""
        form = self.form
        a, b = decoded(m, "a", form, self.a), decoded(m, "b", form, self.b)
        b_sign = named(m, "b_sign", b.sign ^ Const(self.difference, 1))
        unlike = named(m, "unlike", a.sign ^ b_sign)
        return {
            "a_smaller": named(m, "a_smaller", self.a[:-1] < self.b[:-1]),
            "a_above": named(m, "a_above", (a.exponent - b.exponent)[: form.exponent]),
            "b_above": named(m, "b_above", (b.exponent - a.exponent)[: form.exponent]),
            "a_significand": a.significand,
            "b_significand": b.significand,
            "a_exponent": a.exponent,
            "b_exponent": b.exponent,
            "a_sign": a.sign,
            "b_sign": b_sign,
            "nan": a.nan | b.nan | (a.infinite & b.infinite & unlike),
            "infinite": a.infinite | b.infinite,
        }

    def _chosen(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        form, swap = self.form, state["a_smaller"]

        def larger(key: str) -> Value:
            return chosen(swap, state[f"b_{key}"], state[f"a_{key}"])

        count = levels(form.mantissa + 3)
        apart = named(m, "apart", chosen(swap, state["b_above"], state["a_above"]))
        smaller = chosen(swap, state["a_significand"], state["b_significand"])
        return {
            "value": named(m, "smaller", Cat(Const(0, 2), smaller)),
            # Beyond the last place everything falls out, how far ever.
            "amount": fitted(apart, count, False) | apart[count:].any().replicate(count),
            "sticky": Const(0, 1),
            "larger": named(m, "larger", larger("significand")),
            "exponent": named(m, "exponent", larger("exponent")),
            "sign": named(m, "sign", larger("sign")),
            "both_negative": state["a_sign"] & state["b_sign"],
            "unlike": state["a_sign"] ^ state["b_sign"],
            "nan": state["nan"],
            "infinite": state["infinite"],
        }

    def _placed(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """The exponent of the normalised sum, less one, and the bits that decide its rounding."""
        width = exponent_width(self.form, sum_width(self.form))
        below = fitted(state["exponent"], width, False) - state["sum_shift"]
        value = state["sum"]
        return {
            "below": named(m, "below", below[:width]),
            "significand": value[4:],
            "guard": value[3],
            "sticky": value[:3].any(),
            "sign": chosen(state["zero"], state["both_negative"], state["sign"]),
            "zero": state["zero"],
            "infinite": state["infinite"],
            "nan": state["nan"],
        }


def _summed(m: Module, state: dict[str, Value]) -> dict[str, Value]:
    """The larger significand and the smaller one, or less it: never negative."""
    unlike = state["unlike"]
    larger, smaller = Cat(Const(0, 3), state["larger"]), Cat(state["sticky"], state["value"])
    width = len(larger) + 1
    smaller = fitted(smaller, width, False) ^ unlike.replicate(width)
    # The one that a complement lacks comes in by a bit below the last.
    total = Cat(unlike, fitted(larger, width, False)) + Cat(unlike, smaller)
    kept = {key: state[key] for key in ("exponent", "sign", "both_negative", "nan", "infinite")}
    return kept | {"sum": named(m, "sum", total[1 : 1 + width]), "sum_room": state["exponent"]}
