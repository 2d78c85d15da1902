"""The stage behind a unit: rounding, overflow and format as the row says, bit for bit as they are defined."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.fixed import Fixed, Rounding, quantise, rounding_bias
from kalmanhdl.programmable.control import MOST_DROPPED, ROUNDING_BITS, SHIFT_BITS
from kalmanhdl.programmable.operations import ROUNDING_CODES, Stage
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import named
from kalmanhdl.shape import Shape


class RoundingStage(wiring.Component):
    """``arithmetic.fixed.quantise`` of a format that is told, in three clocks.

    ``shift`` comes with ``raw``; ``rounding``, ``width`` and ``unsigned`` a clock later, ``wrap`` two. In
    that clock ``outside`` tells whether the rounded value leaves the format, and in the next ``word`` has
    the result. The rounded value must be a word before it is brought into the format.

    To drop d bits is to append M - d zeros and to drop M, with M the most that are dropped: the value and
    its rounding are the same, and only zeros are appended in a way that depends on the row.
    """

    def __init__(self, raw_width: int, shape: Shape) -> None:
        self._shape = shape
        # What is shifted out at the top is no part of any result.
        self._shifted_width = MOST_DROPPED + shape.word_width + 1
        super().__init__(
            {
                "raw": In(signed(raw_width)),
                "shift": In(SHIFT_BITS),
                "rounding": In(ROUNDING_BITS),
                "width": In(shape.word_width.bit_length()),
                "unsigned": In(1),
                "wrap": In(1),
                "outside": Out(1),
                "word": Out(signed(shape.word_width)),
            }
        )

    def compute(self, raw: int, stage: Stage) -> tuple[int, bool]:
        """What the stage makes of a raw integer, and whether the rounded one left the format."""
        form = Fixed(width=stage.width, fraction=0, signed=stage.signed)
        return quantise(raw, stage.dropped, form, stage.rounding, stage.overflow)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        shifted = Signal(signed(self._shifted_width), reset_less=True)
        rounded = Signal(signed(self._shape.word_width + 1), reset_less=True)
        beyond, unsigned = Signal(len(rounded), reset_less=True), Signal(reset_less=True)
        word = Signal(signed(self._shape.word_width), reset_less=True)
        m.d.sync += [
            shifted.eq(self._lifted(m)),
            *(rounded.eq(self._rounded(m, shifted)), beyond.eq(self._beyond(m)), unsigned.eq(self.unsigned)),
            word.eq(self._limited(m, rounded, beyond, unsigned)),
        ]
        m.d.comb += self.word.eq(word)
        return m

    def _lifted(self, m: Module) -> Value:
        """The raw integer shifted left, bit by bit of the amount."""
        value: Value = self.raw
        for place in range(SHIFT_BITS):
            width = min(len(value) + (1 << place), self._shifted_width)
            both = (fitted(each, width, True) for each in (value.shift_left(1 << place), value))
            value = named(m, f"lifted_{place}", Mux(self.shift[place], *both).as_signed())
        return fitted(value, self._shifted_width, True)

    def _rounded(self, m: Module, shifted: Signal) -> Value:
        biases = {
            ROUNDING_CODES[rounding]: fitted(
                Value.cast(rounding_bias(shifted, MOST_DROPPED, rounding)), MOST_DROPPED, False
            )
            for rounding in Rounding
        }
        bias = Signal(MOST_DROPPED)
        with m.Switch(self.rounding):
            for code, each in biases.items():
                with m.Case(code):
                    m.d.comb += bias.eq(each)
        return (shifted + bias) >> MOST_DROPPED

    def _beyond(self, m: Module) -> Value:
        """A one at every place that only copies the sign: from the sign on, or above all bits."""
        size = self._shape.word_width + 1
        above = Signal(size)
        m.d.comb += above.eq(Cat(self.width <= place for place in range(size)))
        return Mux(self.unsigned, above, Cat(above[1:], Const(1, 1)))

    def _limited(self, m: Module, rounded: Signal, beyond: Signal, unsigned: Signal) -> Value:
        """The value in the format."""
        high = named(m, "high", rounded & beyond)
        out = named(m, "out", Mux(unsigned | ~rounded[-1], high != 0, high != beyond))
        m.d.comb += self.outside.eq(out)
        limit = Mux(rounded[-1], Mux(unsigned, 0, beyond), ~beyond)
        # The lowest of these places is that of the sign.
        lowest = beyond & ~Cat(Const(0, 1), beyond[:-1])
        negative = named(m, "negative", ~unsigned & (rounded & lowest).any())
        wrapped = Mux(negative, rounded | beyond, rounded & ~beyond)
        kept = Mux(out, Mux(self.wrap, wrapped, limit), rounded)
        return fitted(kept, self._shape.word_width, True)
