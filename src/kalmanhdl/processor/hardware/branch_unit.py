"""The branch unit: the clock of the instruction, and which instruction is next."""

from amaranth.hdl import Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION, Core
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.hardware.loop_stack import loop_stack
from kalmanhdl.processor.instructions import ARGUMENT_BITS, OPCODE_BITS, Opcode
from kalmanhdl.processor.timing import clocks_of_instruction


class BranchUnit(wiring.Component):
    """Counts the eight clocks of every instruction; the program counter moves at the end of the last one.

    An instruction that takes eight clocks several times goes through its phases as often.

    ``what_branch`` is the phase: first fetch, second fetch, execute, write back; ``second_clock`` says which
    of its two clocks it is; ``last_clock`` is high in the eighth of the last ones, ``first_round`` in all the
    first ones. ``input_ready`` and ``output_taken`` are
    what the conditional jumps wait for: they are looked at in the seventh clock. Then ``pc_next`` addresses
    the next word, which is there in the eighth.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        super().__init__(
            {
                "running": In(1),
                "opcode": In(OPCODE_BITS),
                "target": In(ARGUMENT_BITS),
                "input_ready": In(1),
                "output_taken": In(1),
                "pc_current": Out(core.program_bits),
                "pc_next": Out(core.program_bits),
                "what_branch": Out(2),
                "second_clock": Out(1),
                "last_clock": Out(1),
                "first_round": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        clock = Signal(range(CLOCKS_PER_INSTRUCTION))
        last = CLOCKS_PER_INSTRUCTION - 1
        m.d.comb += [
            self.what_branch.eq(clock >> 1),
            self.second_clock.eq(clock[0]),
            self.last_clock.eq(self.running & (clock == last) & ~self._again(m, clock == last)),
        ]
        m.d.sync += clock.eq(clock + self.running)
        again: Value = Const(0)
        if self._core.extended:
            again = loop_stack(m, self.last_clock, self.opcode, self.target)
        jumps = Signal()
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
        following = Signal.like(self.pc_current)
        with m.If(self.running):
            target = self.target
            if self._core.extended:
                target = Mux(self.opcode == Opcode.HALT.value, self.pc_current, target)
            m.d.comb += self.pc_next.eq(Mux(jumps, target, self.pc_current + 1))
        with m.If(clock == last - 1):
            m.d.sync += following.eq(self.pc_next)
        with m.If(self.last_clock):
            m.d.sync += self.pc_current.eq(following)
        return m

    def _again(self, m: Module, ends: Value) -> Value:
        """Whether the eight clocks that end are not the instruction's last ones."""
        rounds = self._rounds()
        if not rounds:
            m.d.comb += self.first_round.eq(1)
            return Const(0)
        done = Signal(range(max(rounds)), name="rounds_done")
        m.d.comb += self.first_round.eq(done == 0)
        again: Value = Const(0)
        for count, opcodes in rounds.items():
            again = again | (is_one_of(self.opcode, self._core, opcodes) & (done != count - 1))
        with m.If(self.running & ends):
            m.d.sync += done.eq(Mux(again, done + 1, 0))
        return again

    def _rounds(self) -> dict[int, list[Opcode]]:
        """The instructions that take eight clocks more than once, by how often."""
        found: dict[int, list[Opcode]] = {}
        for opcode in Opcode:
            rounds = clocks_of_instruction(opcode, self._core) // CLOCKS_PER_INSTRUCTION
            if rounds > 1:
                found.setdefault(rounds, []).append(opcode)
        return found
