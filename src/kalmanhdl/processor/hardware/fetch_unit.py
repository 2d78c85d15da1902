"""The front of a pipelined core: which word is fetched, which instruction is about to issue."""

from amaranth.hdl import Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.loop_stack import loop_stack
from kalmanhdl.processor.instructions import ARGUMENT_BITS, ARGUMENTS, OPCODE_BITS, WORD_BITS, Opcode


class FetchUnit(wiring.Component):
    """``word`` is that of the ``store_address`` of the clock before; in the next one it may issue.

    While ``blocked`` it stays. ``issued``: it takes effect in this clock. ``ahead`` are the arguments of the
    instruction that stands there in the next clock, for whoever looks its matrices up. A jump that is taken
    drops the word behind it. ``input_ready`` and ``output_taken`` are what the conditional jumps wait for.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        super().__init__(
            {
                "running": In(1),
                "word": In(WORD_BITS),
                "store_address": Out(core.program_bits),
                "blocked": In(1),
                "input_ready": In(1),
                "output_taken": In(1),
                "issued": Out(1),
                "pc_current": Out(core.program_bits),
                "opcode": Out(OPCODE_BITS),
                "arguments": Out(ARGUMENT_BITS).array(ARGUMENTS),
                "ahead": Out(ARGUMENT_BITS).array(ARGUMENTS),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        fetched = Signal(self._core.program_bits)
        valid = Signal()
        stays = Signal()
        m.d.comb += [self.issued.eq(valid & ~self.blocked), stays.eq(valid & self.blocked)]
        jumps = Signal()
        m.d.comb += jumps.eq(self.issued & self._jumps(m))
        target = Mux(self.opcode == Opcode.HALT.value, self.pc_current, self.arguments[0])
        with m.If(self.running):
            following = Mux(jumps, target, fetched + 1)
            m.d.comb += self.store_address.eq(Mux(stays, fetched, following))
        m.d.sync += fetched.eq(self.store_address)
        places = [ARGUMENT_BITS * (ARGUMENTS - 1 - argument) for argument in range(ARGUMENTS)]
        words = [self.word[place : place + ARGUMENT_BITS] for place in places]
        for ahead, argument, word in zip(self.ahead, self.arguments, words, strict=True):
            m.d.comb += ahead.eq(Mux(stays, argument, word))
            m.d.sync += argument.eq(ahead)
        with m.If(~stays):
            m.d.sync += [
                valid.eq(self.running & ~jumps),
                self.pc_current.eq(fetched),
                self.opcode.eq(self.word[-OPCODE_BITS:]),
            ]
        return m

    def _jumps(self, m: Module) -> Value:
        """Whether the instruction goes elsewhere once it issues."""
        jumps = Signal(name="elsewhere")
        again: Value = Const(0)
        if self._core.extended:
            again = loop_stack(m, self.issued, self.opcode, self.arguments[0])
        with m.Switch(self.opcode):
            with m.Case(Opcode.JUMP_U.value):
                m.d.comb += jumps.eq(1)
            with m.Case(Opcode.JUMP_DRDY.value):
                m.d.comb += jumps.eq(~self.input_ready)
            with m.Case(Opcode.JUMP_ACK.value):
                m.d.comb += jumps.eq(~self.output_taken)
            if self._core.extended:
                with m.Case(Opcode.HALT.value):
                    m.d.comb += jumps.eq(1)
                with m.Case(Opcode.NEXT.value):
                    m.d.comb += jumps.eq(again)
        return jumps
