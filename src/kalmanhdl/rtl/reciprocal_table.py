"""Reciprocals of short divisors: one table of results."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.division import TableNewton, reciprocal
from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.shapes import fitted, shape_of
from kalmanhdl.rtl.stages import Stages
from kalmanhdl.rtl.table import looked_up


class ReciprocalTable(wiring.Component):
    """``arithmetic.division.reciprocal``, bit for bit, of a divisor that addresses a table.

    Ports: ``divisor``, ``quotient``, and ``outside``: the reciprocal does not fit. The result stands
    ``registers`` clocks after its operand. Divisors outside their interval give any result.
    """

    def __init__(
        self,
        divisor: Operand,
        form: Fixed,
        rounding: Rounding,
        method: TableNewton,
        registers: int = 0,
    ) -> None:
        self.divisor_operand, self.form, self.rounding = divisor, form, rounding
        self.method, self.registers = method, registers
        super().__init__(
            {"divisor": In(shape_of(divisor.form)), "quotient": Out(shape_of(form)), "outside": Out(1)}
        )

    def compute(self, divisor: int) -> tuple[int, bool]:
        """The raw reciprocal, and whether it did not fit."""
        return reciprocal(divisor, self.divisor_operand.form.fraction, self.form, self.rounding, self.method)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        width, bits = self.divisor_operand.width, self.form.width
        mask = (1 << bits) - 1
        results = [self.compute(divisor) for divisor in range(1 << width)]
        entries = [quotient & mask | outside << bits for quotient, outside in results]
        entry = looked_up(m, "entry", fitted(self.divisor, width, False), entries, bits + 1)
        result = Stages(m, (1.0,), self.registers).before(1, {"entry": entry})["entry"]
        m.d.comb += [self.quotient.eq(result[:bits]), self.outside.eq(result[bits])]
        return m
