"""The control store: the program, written by the loader on port A and read by the controller on port B."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import WORD_BITS


class ControlStore(wiring.Component):
    """A memory of two ports; ``word_b`` is the word at the ``address_b`` of the clock before."""

    def __init__(self, core: Core) -> None:
        self._words = core.program_words
        super().__init__(
            {
                "address_a": In(core.program_bits),
                "word_a": In(WORD_BITS),
                "enable_a": In(1),
                "address_b": In(core.program_bits),
                "word_b": Out(WORD_BITS),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.memory = memory = Memory(shape=WORD_BITS, depth=self._words, init=[])
        port_a, port_b = memory.write_port(), memory.read_port()
        m.d.comb += [
            port_a.addr.eq(self.address_a),
            port_a.data.eq(self.word_a),
            port_a.en.eq(self.enable_a),
            port_b.addr.eq(self.address_b),
            self.word_b.eq(port_b.data),
        ]
        return m
