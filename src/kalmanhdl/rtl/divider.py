"""Dividers: all rows of a long division one behind the other, or a few of them used again and again."""

from dataclasses import replace

from amaranth.hdl import Module, Value
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.division_structure import Operand, inner, long_structure, row_weights
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.iteration import Iteration
from kalmanhdl.rtl.long_division import LongDivisionCore, row
from kalmanhdl.rtl.stages import Stages


class LongDivider(LongDivisionCore):
    """An array divider: the quotient stands ``registers`` clocks after its operands, for one pair a clock."""

    def __init__(
        self,
        dividend: Operand,
        divisor: Operand,
        form: Fixed,
        rounding: Rounding,
        radix: int = 2,
        registers: int = 0,
    ) -> None:
        self.registers = registers
        structure = long_structure(dividend, divisor, inner(form), rounding, radix)
        super().__init__(dividend, divisor, form, rounding, structure)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        stages = Stages(m, row_weights(self.structure), self.registers)
        state = self.started(m)
        remaining = self.structure.rows
        for step, bits in enumerate(self.structure.row_bits, start=1):
            state = stages.before(step, state)
            add = state["partial"][-1] if step > 1 else state["bits"][0]
            down = state["rest"][remaining - bits : remaining]
            state |= row(m, state, add, down, str(remaining))
            remaining -= bits
        state = stages.before(len(self.structure.row_bits) + 1, state)
        quotient, out = self.finished(state)
        last = len(self.structure.row_bits) + 2
        result = stages.before(last, {"quotient": quotient, "outside": out})
        m.d.comb += [self.quotient.eq(result["quotient"]), self.outside.eq(result["outside"])]
        return m


class IterativeDivider(LongDivisionCore):
    """A divider of ``rows`` rows for one pair of operands at a time: the ports of an ``Iteration``.

    A row finds one bit of the quotient, or two in radix 4.
    """

    def __init__(
        self,
        dividend: Operand,
        divisor: Operand,
        form: Fixed,
        rounding: Rounding,
        radix: int = 2,
        rows: int = 1,
    ) -> None:
        self._bits, self._rows = rows * (radix // 2), rows
        structure = long_structure(dividend, divisor, inner(form), rounding, radix)
        clocks = -(-structure.rows // self._bits)
        self.iteration = Iteration(clocks)
        # Rows before the first that is needed find bits like the sign's.
        structure = replace(structure, rows=clocks * self._bits)
        control = {"start": In(1), "done": Out(1)}
        super().__init__(dividend, divisor, form, rounding, structure, control)

    @property
    def latency(self) -> int:
        """Clocks from the start to the result; sooner no other may start."""
        return self.iteration.latency

    def elaborate(self, platform: object) -> Module:
        m = Module()
        loaded = self.started(m)
        rows = self.structure.rows
        # The sign moves up as the quotient's bits come in below it.
        loaded["bits"] = loaded["bits"].replicate(rows + 1)
        state = self.iteration.built(m, self.start, self.done, loaded, self._advanced)
        quotient, out = self.finished(state)
        m.d.comb += [self.quotient.eq(quotient), self.outside.eq(out)]
        return m

    def _advanced(self, m: Module, state: dict[str, Value]) -> dict[str, Value]:
        """The state after the rows of one clock."""
        state, count = dict(state), self.structure.radix // 2
        rest, bits = state["rest"], state["bits"]
        for place in range(self._rows):
            top = len(rest) - place * count
            down = rest[top - count : top]
            state |= row(m, state, state["partial"][-1], down, str(place))
        return state | {"rest": rest << self._bits, "bits": state["bits"][: len(bits)]}
