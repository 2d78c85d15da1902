"""Floating-point square root: non-restoring rows, one bit of the root a piece."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import exponent_width, levels, root_underflows, rooting
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import decoded, rounded
from kalmanhdl.rtl.floating.shifting import denormalised, normalised
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named


class FloatSquareRoot(wiring.Component):
    """The square root of a: ``arithmetic.floating.square_root``, ``registers`` clocks after its operand."""

    def __init__(self, form: Float, registers: int = 0) -> None:
        self.form, self.registers = form, registers
        super().__init__({"a": In(form.width), "result": Out(form.width)})

    def compute(self, a: int) -> int:
        """The root of an encoded number."""
        return floating.square_root(self.form, a)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        form = self.form
        chain = Chain(m, rooting(form), self.registers)
        a = decoded(m, "a", form, self.a)
        state = {
            "a": a.significand,
            "a_exponent": a.exponent,
            "sign": a.sign & a.zero,
            "zero": a.zero,
            "infinite": a.infinite & ~a.sign,
            "nan": a.nan | (a.sign & ~a.zero),
        }
        if form.subnormals:
            state = normalised(chain, state, levels(form.mantissa), ("a",))
        state = chain.after_piece(self._placed(m, state))
        for digits in range(1, form.mantissa + 2):
            state = chain.after_piece(_with_digit(m, state, digits))
        state = chain.after_piece(_with_remainder(m, state))
        if root_underflows(form):
            state = denormalised(chain, form, state)
        m.d.comb += self.result.eq(rounded(chain, form, state))
        chain.finish()
        return m

    def _placed(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """Half the exponent, and the radicand, twice as large where the exponent is odd; its first digit."""
        form = self.form
        width = exponent_width(form, form.mantissa)
        exponent = fitted(state.pop("a_exponent"), width, True) - state.pop("a_shift", Const(0, 1))
        exponent = named(m, "exponent", exponent[:width].as_signed())
        # The bias is odd.
        odd, significand = ~exponent[0], state.pop("a")
        radicand = Mux(odd, Cat(Const(0, 1), significand), significand)[: form.mantissa + 2]
        below = (exponent + form.bias).shift_right(1) - 1
        return state | {
            "below": named(m, "below", below[:width]),
            "root": Const(1, 1),
            "partial": Cat((radicand[-2:] - 1)[:2], Const(0, 1)),
            "left": radicand[:-2],
        }


def _with_digit(m: Module, state: dict[str, Value], digits: int) -> dict[str, Value]:
    """The root with one more digit; a negative partial remainder is one whose digit is 0."""
    partial, root, left = state["partial"], state["root"], state["left"]
    down = Cat(Const(0, 2), left)[len(left) :]
    width = digits + 3
    positive = ~partial[-1]
    # 4 r - (4 q + 1), or 4 r + 4 q + 3 where r is negative: either way it ends in 11.
    addend = Cat(Const(3, 2), root ^ positive.replicate(digits), positive)
    shifted = fitted(Cat(down, partial).as_signed(), width, False)
    partial = named(m, f"partial_{digits}", (shifted + addend)[:width])
    return state | {
        "partial": partial,
        "root": Cat(~partial[-1], root),
        "left": Cat(Const(0, 2), left)[: len(left)],
    }


def _with_remainder(m: Module, state: dict[str, Value]) -> dict[str, Value]:
    partial, root = state.pop("partial"), state.pop("root")
    del state["left"]
    back = Mux(partial[-1], Cat(Const(1, 1), root), 0)
    rest = named(m, "rest", (partial + back)[: len(partial)])
    return state | {"significand": root[1:], "guard": root[0], "sticky": rest.any()}
