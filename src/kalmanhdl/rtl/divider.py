"""Long division in hardware: non-restoring rows of one or two quotient bits."""

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.division import divide
from kalmanhdl.arithmetic.division_structure import ONE, Operand, bits_of, long_structure, row_weights
from kalmanhdl.arithmetic.fixed import Fixed, Rounding, outside, saturated
from kalmanhdl.rtl.shapes import fitted, shape_of, shifted_sum
from kalmanhdl.rtl.stages import Stages, named


class LongDivider(wiring.Component):
    """The exact quotient of two raw integers, rounded once and saturated: ``arithmetic.division.divide``.

    Ports: ``dividend`` (none for ``ONE``: a reciprocal), ``divisor``, ``quotient``, and
    ``outside``: the exact quotient does not fit. The result stands ``registers`` clocks after its
    operands. Operands outside their interval give any result.
    """

    def __init__(
        self,
        dividend: Operand,
        divisor: Operand,
        form: Fixed,
        rounding: Rounding,
        radix: int = 2,
        registers: int = 0,
    ) -> None:
        self.dividend_operand, self.divisor_operand = dividend, divisor
        self.form, self.rounding, self.registers = form, rounding, registers
        self.structure = long_structure(dividend, divisor, _inner(form), rounding, radix)
        ports = {
            "divisor": In(shape_of(divisor.form)),
            "quotient": Out(shape_of(form)),
            "outside": Out(1),
        }
        if dividend != ONE:
            ports["dividend"] = In(shape_of(dividend.form))
        super().__init__(ports)

    def compute(self, dividend: int, divisor: int) -> tuple[int, bool]:
        """The raw quotient, and whether the exact one did not fit."""
        a, b = self.dividend_operand.form.fraction, self.divisor_operand.form.fraction
        return divide(dividend, a, divisor, b, self.form, self.rounding)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        structure = self.structure
        stages = Stages(m, row_weights(structure), self.registers)
        state = self._started(m)
        remaining = structure.rows
        for step, bits in enumerate(structure.row_bits, start=1):
            state = stages.before(step, state)
            state |= _row(m, state, remaining, bits)
            remaining -= bits
        state = stages.before(len(structure.row_bits) + 1, state)
        quotient, out = self._finished(state)
        result = stages.before(len(structure.row_bits) + 2, {"quotient": quotient, "outside": out})
        m.d.comb += [self.quotient.eq(result["quotient"]), self.outside.eq(result["outside"])]
        return m

    def _started(self, m: Module) -> dict[str, Value]:
        """What the first row reads: the dividend with its rounding, and the flags of the quotient."""
        operand = self.dividend_operand
        divisor = fitted(self.divisor, self.structure.row_width - 1, False)
        if operand.low == operand.high:
            dividend: Value = Const(operand.low, Shape(operand.width, operand.signed))
        else:
            dividend = fitted(self.dividend, operand.width, operand.signed)
        total, dropped = self._biased(m, dividend, divisor)
        rest = named(m, "rest", total >> dropped)[: max(len(total) - dropped, 1)]
        rest = rest.as_signed() if self.structure.negative else rest
        state = {
            "divisor": divisor,
            "partial": fitted(rest >> self.structure.rows, self.structure.row_width, False),
            "rest": fitted(rest, self.structure.rows, False),
            "bits": rest[-1] if self.structure.negative else Const(0, 1),
        }
        if self.structure.radix == 4:
            state["triple"] = named(
                m, "triple", fitted(divisor + (divisor << 1), self.structure.row_width, False)
            )
        if self.structure.ties:
            state["on_point"] = total[:dropped] == 0
        return state | self._flags(m, rest, divisor)

    def _biased(self, m: Module, dividend: Value, divisor: Value) -> tuple[Value, int]:
        """The number whose floor quotient is the rounded one, and its bits below the divisor's last."""
        exponent = (
            self.divisor_operand.form.fraction - self.dividend_operand.form.fraction + self.form.fraction
        )
        up, down = max(exponent, 0), max(-exponent, 0)
        divisor = divisor.shift_left(down)
        half = self.rounding in (Rounding.HALF_UP, Rounding.HALF_EVEN)
        up, down = up + half, down + half
        operand = self.dividend_operand
        low, high = operand.low << up, operand.high << up
        bound = self.divisor_operand.high << down
        width = bits_of(min(low, 0) - 1, high + bound)
        if half:
            total = shifted_sum(dividend, up, divisor, width)
        elif self.rounding is Rounding.TOWARD_ZERO and operand.signed:
            bias = Mux(dividend < 0, fitted(divisor, len(divisor) + 1, True) - 1, 0)
            total = shifted_sum(dividend, up, bias, width)
        else:
            total = fitted(dividend.shift_left(up), width, True)
        return named(m, "biased", total), down

    def _flags(self, m: Module, rest: Value, divisor: Value) -> dict[str, Value]:
        """Whether the floor quotient lies above or below the format. A zero divisor is on a side too."""
        flags: dict[str, Value] = {}
        form = _inner(self.form)
        top = rest >> form.highest.bit_length()
        if self.structure.above:
            flags["above"] = named(m, "above", top >= divisor)
        if self.structure.below:
            flags["below"] = named(m, "below", top + divisor < 0 if form.signed else rest < 0)
        return flags

    def _finished(self, state: dict[str, Value]) -> tuple[Value, Value]:
        bits = state["bits"]
        if self.structure.ties:
            tie = (state["partial"] == 0) & state["on_point"]
            bits = Cat(bits[0] & ~tie, bits[1:])
        quotient = bits.as_signed() if self.structure.negative else bits[:-1]
        above, below = state.get("above", Const(0, 1)), state.get("below", Const(0, 1))
        form = _inner(self.form)
        quotient = Mux(above, form.highest, Mux(below, form.lowest, quotient))
        out = above | below
        if form != self.form:
            out = out | outside(quotient, self.form)
            quotient = saturated(quotient, self.form, Mux)
        return fitted(quotient, self.form.width, self.form.signed), out


def _inner(form: Fixed) -> Fixed:
    # Parity decides ties only in a format whose greatest number is odd, which 0 is not.
    if form.highest == 0:
        return Fixed(width=2, fraction=form.fraction)
    return form


def _row(m: Module, state: dict[str, Value], remaining: int, count: int) -> dict[str, Value]:
    """The partial remainder after one or two more quotient bits, ``remaining`` were to be found before.

    A partial remainder lies in [-divisor, divisor); its sign is the quotient bit, inverted.
    """
    divisor, partial, bits, rest = (state[key] for key in ("divisor", "partial", "bits", "rest"))
    width = len(partial)
    add = partial[-1] if len(bits) > 1 else bits[0]

    def stepped(brought_down: int, multiple: Value, name: str) -> Value:
        shifted = Cat(rest[remaining - brought_down : remaining], partial)[:width]
        subtrahend = fitted(multiple, width, False) ^ (~add).replicate(width)
        return named(m, f"{name}_{remaining}", (shifted + subtrahend + ~add)[:width])

    first = stepped(1, divisor, "partial")
    if count == 1:
        return {"partial": first, "bits": Cat(~first[-1], bits)}
    near, far = stepped(2, divisor, "near"), stepped(2, state["triple"], "far")
    second = named(m, f"second_{remaining}", Mux(first[-1] == add, far, near))
    return {"partial": second, "bits": Cat(~second[-1], ~first[-1], bits)}
