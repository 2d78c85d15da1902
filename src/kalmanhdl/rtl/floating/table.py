"""A table whose rows are asked for by a floating-point number."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.float_structure import levels, row_number
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.floating.encoding import decoded
from kalmanhdl.rtl.floating.shifting import shifted_right
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named
from kalmanhdl.rtl.table import looked_up


class FloatTable(wiring.Component):
    """The row, an encoded number, whose number is the whole part of a, ``registers`` clocks after it.

    A number below 0 and NaN ask for the first row, one beyond the last row for the last.
    """

    def __init__(self, form: Float, rows: tuple[int, ...], registers: int = 0) -> None:
        self.form, self.rows, self.registers = form, rows, registers
        self._places = levels(len(rows) - 1)
        super().__init__({"a": In(form.width), "result": Out(form.width)})

    def compute(self, a: int) -> int:
        """The row that an encoded number asks for."""
        form = self.form
        if form.is_nan(a) or a & form.sign:
            return self.rows[0]
        last = len(self.rows) - 1
        return self.rows[last if form.is_infinite(a) else min(int(form.real(a)), last)]

    def elaborate(self, platform: object) -> Module:
        m = Module()
        chain = Chain(m, row_number(self.form, len(self.rows)), self.registers)
        state = chain.after_piece(self._placed(m))
        state = shifted_right(chain, state, levels(self._places), self._places)
        last = len(self.rows) - 1
        beyond = state["beyond"] | (state["value"] > last)
        number = named(m, "number", Mux(beyond, last, state["value"])[: self._places])
        row = looked_up(
            m, "row", number & state["counts"].replicate(self._places), self.rows, self.form.width
        )
        m.d.comb += self.result.eq(chain.after_piece({"result": row})["result"])
        chain.finish()
        return m

    def _placed(self, m: Module) -> dict[str, Value]:
        """The leading bits of the significand, and how far they stand above the last whole bit."""
        form, count = self.form, levels(self._places)
        parts = decoded(m, "a", form, self.a)
        width = max(form.exponent, count) + 2
        exponent = fitted(parts.exponent, width, True)
        apart = named(m, "apart", (form.bias + self._places - 1 - exponent)[:width])
        whole = Cat(Const(0, self._places), parts.significand)[-self._places :]
        return {
            "value": whole,
            "amount": apart[:count] | apart[count:-1].any().replicate(count),
            "sticky": Const(0, 1),
            "beyond": apart[-1],
            "counts": ~parts.sign & ~parts.nan,
        }
