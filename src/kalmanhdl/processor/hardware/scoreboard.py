"""The scoreboard of a pipelined core: which results are on their way, and who must wait for them."""

from collections.abc import Mapping

from amaranth.hdl import Const, Module, Mux, Signal, Value, unsigned
from amaranth.lib import wiring
from amaranth.lib.data import StructLayout
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.instructions import (
    ARGUMENT_BITS,
    ARGUMENTS,
    OPCODE_BITS,
    Instruction,
    Opcode,
)
from kalmanhdl.processor.timing import behind, latency, sources, uses_array


def result_layout(core: Core) -> StructLayout:
    """A result on its way: whose it is, and where it goes."""
    return StructLayout(
        {
            "valid": unsigned(1),
            "opcode": unsigned(OPCODE_BITS),
            "element": unsigned(ARGUMENT_BITS),
            "matrix": unsigned(core.address_bits),
        }
    )


class Scoreboard(wiring.Component):
    """Which results are on their way, and where to.

    ``blocked``: the instruction must wait, for its sources, for an earlier result of its destination, for the
    array of multipliers, or for the way into the store. ``issued`` puts its result on the way; ``array_left``
    are the passes that the array has left, ``starts`` is high where it takes the instruction. ``stored`` is
    the result that is stored in this clock: whoever issues in it can have it.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self._opcodes = [each for each in Opcode if core.has(each)]
        self._most = max(latency(each, core) for each in self._opcodes)
        alone = max(latency(each, core) for each in self._opcodes if not uses_array(each, core))
        # Instructions of the array by the clocks from its last pass to their slot.
        self._behind: dict[int, list[Opcode]] = {}
        for each in self._opcodes:
            if uses_array(each, core):
                self._behind.setdefault(behind(each, core), []).append(each)
        self._slots = max(alone, 1 + max(self._behind))
        super().__init__(
            {
                "opcode": In(OPCODE_BITS),
                "arguments": In(ARGUMENT_BITS).array(ARGUMENTS),
                "issued": In(1),
                "array_left": In(range(self._most + 1)),
                "blocked": Out(1),
                "starts": Out(1),
                "stored": Out(result_layout(core)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = self._core
        slots = [Signal(result_layout(core), name=f"slot_{k}") for k in range(self._slots)]
        of_array = Signal(result_layout(core))
        takes = Signal(range(self._most + 1))
        with m.Switch(self.opcode):
            for each in self._opcodes:
                with m.Case(each.value):
                    m.d.comb += takes.eq(latency(each, core))
        for_array = is_one_of(self.opcode, core, [each for some in self._behind.values() for each in some])
        busy = self.array_left != 0
        of_slot = {k: is_one_of(of_array.opcode, core, some) for k, some in self._behind.items()}
        added: Value = Const(0)
        for k, is_it in of_slot.items():
            added = Mux(is_it, k, added) if k else added
        array_remains = self.array_left + added
        coming = [(busy, of_array, array_remains)]
        coming += [(slots[k].valid, slots[k], Const(k)) for k in range(1, self._slots)]
        addresses = [each[: core.address_bits] for each in self.arguments]
        used = self._used()
        waits = for_array & (self.array_left > 1)
        for valid, result, remains in coming:
            for uses, address in zip(used, addresses, strict=True):
                waits = waits | (valid & uses & (result.matrix == address))
            same = result.matrix == addresses[2]
            late = (takes == remains) | (same & (takes < remains))
            waits = waits | (valid & (takes != 0) & late)
        m.d.comb += [
            self.blocked.eq(waits),
            self.stored.eq(slots[0]),
            self.starts.eq(self.issued & for_array),
        ]
        new = Signal(result_layout(core))
        m.d.comb += [
            new.valid.eq(self.issued & (takes != 0)),
            new.opcode.eq(self.opcode),
            new.element.eq(self.arguments[1]),
            new.matrix.eq(addresses[2]),
        ]
        with m.If(self.starts):
            m.d.sync += of_array.eq(new)
        self._shift(m, slots, of_array, new, (for_array, takes), of_slot)
        return m

    def _used(self) -> list[Value]:
        """Whether the matrices at the three arguments are read."""
        core = self._core
        # Every argument as its own number tells which of them are matrices that are read.
        read = {each: sources(Instruction(each, (0, 1, 2))) for each in self._opcodes}
        return [
            is_one_of(self.opcode, core, [each for each in self._opcodes if argument in read[each]])
            for argument in range(ARGUMENTS)
        ]

    def _shift(
        self,
        m: Module,
        slots: list[Signal],
        of_array: Signal,
        new: Signal,
        about: tuple[Value, Value],
        of_slot: Mapping[int, Value],
    ) -> None:
        """Every result is a clock nearer; those of the array come in with its last pass."""
        for_array, takes = about
        last = self.array_left == 1
        for k, slot in enumerate(slots):
            following = slots[k + 1] if k + 1 < self._slots else Const(0, result_layout(self._core).size)
            m.d.sync += slot.eq(following)
            with m.If(new.valid & ~for_array & (takes == k + 1)):
                m.d.sync += slot.eq(new)
            if k in of_slot:
                with m.If(last & of_slot[k]):
                    m.d.sync += slot.eq(of_array)
