"""The reciprocal unit that looks its results up."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.division import TableNewton, reciprocal_table
from kalmanhdl.rtl.leading_one import leading_zeros, shifted_left
from kalmanhdl.rtl.stages import named
from kalmanhdl.rtl.table import looked_up
from kalmanhdl.shape import Shape


class TableReciprocal(wiring.Component):
    """The reciprocal of ``arithmetic.division.TableNewton`` without a Newton step, before it is rounded.

    The word, three clocks after its divisor, has ``fraction`` more fraction bits than the divisor has less of
    them: word / 2**(fraction - those of the divisor) is what the table says. Of a divisor 0, or below, it is
    the greatest word.
    """

    def __init__(self, shape: Shape, index_bits: int) -> None:
        self._shape, self._method = shape, TableNewton(index_bits=index_bits, iterations=0)
        super().__init__({"divisor": In(signed(shape.number_width)), "word": Out(signed(shape.word_width))})

    def compute(self, divisor: int) -> int:
        """The word of a divisor above 0."""
        count = self._method.index_bits
        index = (divisor << count >> (divisor.bit_length() - 1)) & ((1 << count) - 1)
        return reciprocal_table(count)[index] << (self._shape.number_width - 1 - divisor.bit_length())

    def elaborate(self, platform: object) -> Module:
        m = Module()
        width, count = self._shape.number_width - 1, self._method.index_bits
        divisor = Signal(width)
        m.d.comb += divisor.eq(Mux(self.divisor[-1], 0, self.divisor))
        amount = Signal(range(width + 1), reset_less=True)
        normalised, none = Signal(width, reset_less=True), Signal(reset_less=True)
        zeros = named(m, "zeros", leading_zeros(divisor))
        m.d.sync += [amount.eq(zeros), normalised.eq(shifted_left(m, "shifted", divisor, zeros, 0))]
        m.d.sync += none.eq(divisor == 0)
        # The bits below the leading one; zeros where there are no more.
        index = Cat(Const(0, max(count - width + 1, 0)), normalised[max(width - 1 - count, 0) : -1])
        entries, entry_width = reciprocal_table(count), self._method.table_fraction + 1
        found = looked_up(m, "entry", index, entries, entry_width)
        entry, places = Signal(entry_width, reset_less=True), Signal.like(amount, reset_less=True)
        never = Signal(reset_less=True)
        m.d.sync += [entry.eq(found), places.eq(amount), never.eq(none)]
        moved = shifted_left(m, "moved", entry, places, width - 1)
        word = Signal(self._shape.word_width - 1, reset_less=True)
        m.d.sync += word.eq(Mux(never, ~Const(0, len(word)), moved))
        m.d.comb += self.word.eq(word)
        return m
