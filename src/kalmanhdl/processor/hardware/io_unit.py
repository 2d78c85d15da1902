"""The I/O unit: numbers in and out by handshakes, and the signals that the conditional jumps wait for."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.layouts import matrix_layout, word_shape
from kalmanhdl.processor.instructions import ARGUMENT_BITS, OPCODE_BITS, Opcode


class IoUnit(wiring.Component):
    """Decodes the opcodes that are its own; whatever it does, it does at the last clock of the instruction.

    READ raises ACK_I, JUMP_DRDY drops it. WRITE raises DRDY_O and puts the element of the source on
    ``data_out``, where it stays until the next WRITE; JUMP_ACK drops DRDY_O. ``chosen`` is the element of the
    source that the instruction names.
    """

    def __init__(self, core: Core) -> None:
        super().__init__(
            {
                "opcode": In(OPCODE_BITS),
                "element": In(ARGUMENT_BITS),
                "last_clock": In(1),
                "source": In(matrix_layout(core)),
                "ack_i": Out(1),
                "drdy_o": Out(1),
                "data_out": Out(word_shape(core)),
                "chosen": Out(word_shape(core)),
            }
        )
        self._index_bits = (core.elements - 1).bit_length()

    def elaborate(self, platform: object) -> Module:
        m = Module()
        index = self.element[: self._index_bits]
        with m.Switch(index):
            for number, element in enumerate(self.source):
                with m.Case(number):
                    m.d.comb += self.chosen.eq(element)
        with m.If(self.last_clock), m.Switch(self.opcode):
            with m.Case(Opcode.READ.value):
                m.d.sync += self.ack_i.eq(1)
            with m.Case(Opcode.JUMP_DRDY.value):
                m.d.sync += self.ack_i.eq(0)
            with m.Case(Opcode.WRITE.value):
                m.d.sync += [self.drdy_o.eq(1), self.data_out.eq(self.chosen)]
            with m.Case(Opcode.JUMP_ACK.value):
                m.d.sync += self.drdy_o.eq(0)
        return m
