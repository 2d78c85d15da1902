"""Long division in hardware: what stands before, in and after the non-restoring rows of quotient bits."""

from collections.abc import Mapping
from types import MappingProxyType

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Member, Out

from kalmanhdl.arithmetic.division import divide
from kalmanhdl.arithmetic.division_structure import ONE, LongStructure, Operand, bits_of, inner
from kalmanhdl.arithmetic.fixed import Fixed, Rounding, outside, saturated
from kalmanhdl.rtl.shapes import fitted, shape_of, shifted_sum
from kalmanhdl.rtl.stages import named


class LongDivisionCore(wiring.Component):
    """The exact quotient of two raw integers, rounded once and saturated: ``arithmetic.division.divide``.

    Ports: ``dividend`` (none for ``ONE``: a reciprocal), ``divisor``, ``quotient``, ``outside`` (the exact
    quotient does not fit), and those of ``control``. Operands outside their interval give any result.
    """

    def __init__(
        self,
        dividend: Operand,
        divisor: Operand,
        form: Fixed,
        rounding: Rounding,
        structure: LongStructure,
        control: Mapping[str, Member] = MappingProxyType({}),
    ) -> None:
        self.dividend_operand, self.divisor_operand = dividend, divisor
        self.form, self.rounding, self.structure = form, rounding, structure
        ports = {
            "divisor": In(shape_of(divisor.form)),
            "quotient": Out(shape_of(form)),
            "outside": Out(1),
        }
        if dividend != ONE:
            ports["dividend"] = In(shape_of(dividend.form))
        super().__init__(ports | dict(control))

    def compute(self, dividend: int, divisor: int) -> tuple[int, bool]:
        """The raw quotient, and whether the exact one did not fit."""
        a, b = self.dividend_operand.form.fraction, self.divisor_operand.form.fraction
        return divide(dividend, a, divisor, b, self.form, self.rounding)

    def started(self, m: Module) -> dict[str, Value]:
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
        form = inner(self.form)
        top = rest >> form.highest.bit_length()
        if self.structure.above:
            flags["above"] = named(m, "above", top >= divisor)
        if self.structure.below:
            flags["below"] = named(m, "below", top + divisor < 0 if form.signed else rest < 0)
        return flags

    def finished(self, state: dict[str, Value]) -> tuple[Value, Value]:
        """The quotient after the last row, and whether it did not fit."""
        bits = state["bits"]
        if self.structure.ties:
            tie = (state["partial"] == 0) & state["on_point"]
            bits = Cat(bits[0] & ~tie, bits[1:])
        quotient = bits.as_signed() if self.structure.negative else bits[:-1]
        above, below = state.get("above", Const(0, 1)), state.get("below", Const(0, 1))
        form = inner(self.form)
        quotient = Mux(above, form.highest, Mux(below, form.lowest, quotient))
        out = above | below
        if form != self.form:
            out = out | outside(quotient, self.form)
            quotient = saturated(quotient, self.form, Mux)
        return fitted(quotient, self.form.width, self.form.signed), out


def row(m: Module, state: dict[str, Value], add: Value, down: Value, place: str) -> dict[str, Value]:
    """The partial remainder and the quotient bits after a row that finds as many bits as ``down`` has.

    ``down`` are the dividend's bits brought down, ``add`` is the sign of the partial remainder: it lies in
    [-divisor, divisor), and its sign is the quotient bit, inverted. ``place`` tells names apart.
    """
    divisor, partial, bits = (state[key] for key in ("divisor", "partial", "bits"))
    width = len(partial)

    def stepped(brought_down: Value, multiple: Value, name: str) -> Value:
        shifted = Cat(brought_down, partial)[:width]
        subtrahend = fitted(multiple, width, False) ^ (~add).replicate(width)
        return named(m, f"{name}_{place}", (shifted + subtrahend + ~add)[:width])

    first = stepped(down[-1:], divisor, "partial")
    if len(down) == 1:
        return {"partial": first, "bits": Cat(~first[-1], bits)}
    near, far = stepped(down, divisor, "near"), stepped(down, state["triple"], "far")
    second = named(m, f"second_{place}", Mux(first[-1] == add, far, near))
    return {"partial": second, "bits": Cat(~second[-1], ~first[-1], bits)}
