"""Comparison of floating-point numbers."""

from amaranth.hdl import Const, Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.float_structure import comparison
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import decoded
from kalmanhdl.rtl.stages import named


class FloatComparer(wiring.Component):
    """How a stands to b: ``arithmetic.floating.compare``, ``registers`` clocks after its operands.

    The bits of ``result`` from the lowest: less, equal, greater, unordered. Just one is set.
    """

    def __init__(self, form: Float, registers: int = 0) -> None:
        self.form, self.registers = form, registers
        super().__init__({"a": In(form.width), "b": In(form.width), "result": Out(4)})

    def compute(self, a: int, b: int) -> int:
        """The bits for encoded numbers."""
        return 1 << floating.compare(self.form, a, b)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        chain = Chain(m, comparison(self.form), self.registers)
        state = chain.after_piece(self._judged(m))
        m.d.comb += self.result.eq(chain.after_piece(_ordered(m, state))["result"])
        chain.finish()
        return m

    def _judged(self, m: Module) -> dict[str, Value]:
        """The magnitudes against each other, and what does not rest on them."""
        form = self.form
        a, b = decoded(m, "a", form, self.a), decoded(m, "b", form, self.b)
        # Where subnormals do not count, all of them are one zero.
        x, y = (raw[:-1] & ~parts.zero.replicate(form.width - 1) for raw, parts in ((self.a, a), (self.b, b)))
        return {
            "below": named(m, "below", x < y),
            "same": named(m, "same", x == y),
            "a_sign": a.sign & ~a.zero,
            "b_sign": b.sign & ~b.zero,
            "unordered": a.nan | b.nan,
        }


def _ordered(m: Module, state: dict[str, Value]) -> dict[str, Value]:
    a_sign, b_sign, ordered = state["a_sign"], state["b_sign"], ~state["unordered"]
    equal = named(m, "equal", state["same"] & ~(a_sign ^ b_sign))
    # Of two negative numbers the one of smaller magnitude is greater.
    less = named(m, "less", (a_sign & ~b_sign) | ~(a_sign ^ b_sign) & (state["below"] ^ a_sign) & ~equal)
    greater = ~less & ~equal
    result = Const(0, 4)
    for place, flag in enumerate((less & ordered, equal & ordered, greater & ordered, ~ordered)):
        result = result | (flag.as_unsigned() << place)
    return {"result": named(m, "order", result[:4])}
