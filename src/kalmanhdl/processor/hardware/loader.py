"""The loader: fills the control store once after a reset, then stands still."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import WORD_BITS


class Loader(wiring.Component):
    """Takes the words of a program one after the other and stores them from address 0 on.

    A word transfers in a clock in which ``valid`` and ``ready`` are high. After the word with ``last`` the
    rest of the store is filled with NOP; then ``running`` rises and stays.
    """

    def __init__(self, core: Core) -> None:
        self._last = core.program_words - 1
        super().__init__(
            {
                "word": In(WORD_BITS),
                "last": In(1),
                "valid": In(1),
                "ready": Out(1),
                "store_address": Out(core.program_bits),
                "store_word": Out(WORD_BITS),
                "store_enable": Out(1),
                "running": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        filling = Signal()
        loaded = Signal()
        m.d.comb += [
            self.ready.eq(~filling & ~loaded),
            self.store_enable.eq(filling | (self.valid & self.ready)),
            self.store_word.eq(Mux(filling, 0, self.word)),
        ]
        with m.If(self.store_enable):
            m.d.sync += [self.store_address.eq(self.store_address + 1), filling.eq(filling | self.last)]
            with m.If(self.store_address == self._last):
                m.d.sync += [loaded.eq(1), filling.eq(0)]
        # The first word is read meanwhile.
        m.d.sync += self.running.eq(loaded)
        return m
