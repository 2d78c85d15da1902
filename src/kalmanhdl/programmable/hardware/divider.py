"""The reciprocal unit: a power of two by a divisor, some bits of the quotient a clock."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.programmable.control import QUOTIENT_BITS_PER_CLOCK, quotient_bits, quotient_clocks
from kalmanhdl.rtl.stages import named
from kalmanhdl.shape import Shape


class PowerDivider(wiring.Component):
    """2**exponent / divisor, restoring: twice the integer quotient, and a bit that says if something is left.

    ``begin`` takes ``divisor``, which counts as 0 where it is negative; the exponent is said by the
    ``clocks`` in which bits of the quotient come, and by the ``place``, from the end, of the dividend's one
    among the bits of the first of them. The word is there a clock later, and stays until the next begins.
    A quotient by 0 is beyond every format that is a bit shorter than the quotient.
    """

    def __init__(self, shape: Shape) -> None:
        self._shape, self._bits = shape, quotient_bits(shape)
        most = quotient_clocks(self._bits - 1)
        super().__init__(
            {
                "begin": In(1),
                "divisor": In(signed(shape.number_width)),
                "clocks": In(most.bit_length()),
                "place": In((QUOTIENT_BITS_PER_CLOCK - 1).bit_length()),
                "word": Out(signed(shape.word_width)),
            }
        )

    def compute(self, divisor: int, exponent: int) -> int:
        """The word of a quotient by more than 0."""
        quotient, rest = divmod(1 << exponent, divisor)
        return 2 * quotient + (rest != 0)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        width = self._shape.number_width - 1
        divisor, rest = Signal(width, reset_less=True), Signal(width, reset_less=True)
        quotient = Signal(self._bits, reset_less=True)
        # Of the dividend, what is still to be taken in.
        dividend = Signal(QUOTIENT_BITS_PER_CLOCK, reset_less=True)
        left = Signal.like(self.clocks, reset_less=True)
        with m.If(self.begin):
            m.d.sync += [
                divisor.eq(Mux(self.divisor[-1], 0, self.divisor)),
                *(rest.eq(0), quotient.eq(0)),
                *(dividend.eq(Const(1, 1) << self.place), left.eq(self.clocks)),
            ]
        with m.Elif(left != 0):
            after, bits = self._steps(m, rest, divisor, dividend)
            m.d.sync += [
                *(left.eq(left - 1), dividend.eq(0)),
                *(rest.eq(after), quotient.eq(Cat(*bits, quotient))),
            ]
        by_zero = named(m, "by_zero", divisor == 0)
        m.d.comb += self.word.eq(
            Cat(by_zero | (rest != 0), quotient | by_zero.replicate(self._bits), Const(0, 1))
        )
        return m

    def _steps(self, m: Module, rest: Value, divisor: Value, dividend: Value) -> tuple[Value, list[Value]]:
        """The rest after the steps of a clock, and the bits of the quotient, the last one first."""
        bits: list[Value] = []
        for step in range(QUOTIENT_BITS_PER_CLOCK):
            taken = named(m, f"taken_{step}", Cat(dividend[-1 - step], rest))
            less = named(m, f"less_{step}", taken - divisor)
            rest = named(m, f"rest_{step}", Mux(less[-1], taken, less)[: len(divisor)])
            bits.insert(0, ~less[-1])
        return rest, bits
