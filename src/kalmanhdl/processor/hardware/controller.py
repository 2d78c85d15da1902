"""The controller: loader, control store, branch unit, I/O unit, data store and arithmetic unit together."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.alu import Alu
from kalmanhdl.processor.hardware.branch_unit import BranchUnit
from kalmanhdl.processor.hardware.control_store import ControlStore
from kalmanhdl.processor.hardware.data_store import DataStore
from kalmanhdl.processor.hardware.decoding import stores
from kalmanhdl.processor.hardware.float_alu import FloatAlu
from kalmanhdl.processor.hardware.io_unit import IoUnit
from kalmanhdl.processor.hardware.layouts import matrix_layout, taken, word_shape
from kalmanhdl.processor.hardware.loader import Loader
from kalmanhdl.processor.instructions import ARGUMENT_BITS, OPCODE_BITS, WORD_BITS, Opcode


class Controller(wiring.Component):
    """The paper's controller: eight clocks an instruction, or as often eight as it needs.

    After a reset it takes a program (the ports ``program_*``) and runs it. ``saturated`` says that a result
    since the reset did not fit its format. The last ports are looks inside, as the paper has them; they may
    stay open.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        word = word_shape(core)
        super().__init__(
            {
                "program_word": In(WORD_BITS),
                "program_last": In(1),
                "program_valid": In(1),
                "program_ready": Out(1),
                "data_in": In(word),
                "DRDY_I": In(1),
                "ACK_I": Out(1),
                "data_out": Out(word),
                "DRDY_O": Out(1),
                "ACK_O": In(1),
                "saturated": Out(1),
                "running": Out(1),
                "pc_current": Out(core.program_bits),
                "what_branch": Out(2),
                "last_clock": Out(1),
                "opcode": Out(OPCODE_BITS),
                "argument_1": Out(ARGUMENT_BITS),
                "argument_2": Out(ARGUMENT_BITS),
                "argument_3": Out(ARGUMENT_BITS),
                "written_elements": Out(core.elements),
                "written": Out(matrix_layout(core)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        store = ControlStore(self._core)
        m.submodules.control_store = store
        self._load(m, store)
        branch = self._branch(m, store)
        instruction = Cat(self.argument_3, self.argument_2, self.argument_1, self.opcode)
        with m.If(self.last_clock | ~self.running):
            m.d.sync += instruction.eq(store.word_b)
        data = DataStore(self._core)
        m.submodules.data_store = data
        a = Signal(matrix_layout(self._core), reset_less=True)
        fetch, second = branch.what_branch, branch.second_clock
        with m.If((fetch == 0) & second):
            m.d.sync += a.eq(data.read[0])
        chosen = self._exchange(m, branch, a)
        alu = self._alu(m, branch, chosen)
        m.d.comb += alu.exponent.eq(self.argument_2)
        m.d.comb += [alu.opcode.eq(self.opcode), alu.a.eq(a), alu.fetched.eq(data.read[0])]
        m.d.comb += alu.take_b.eq((fetch == 1) & second)
        address = data.addresses[0]
        m.d.comb += data.write_address.eq(address)
        with m.Switch(fetch):
            with m.Case(0):
                m.d.comb += address.eq(self.argument_1)
            with m.Case(1):
                m.d.comb += address.eq(self.argument_2)
            with m.Default():
                m.d.comb += address.eq(self.argument_3)
        self._write_back(m, data, alu)
        return m

    def _load(self, m: Module, store: ControlStore) -> None:
        loader = Loader(self._core)
        m.submodules.loader = loader
        m.d.comb += [
            loader.word.eq(self.program_word),
            loader.last.eq(self.program_last),
            loader.valid.eq(self.program_valid),
            self.program_ready.eq(loader.ready),
            store.address_a.eq(loader.store_address),
            store.word_a.eq(loader.store_word),
            store.enable_a.eq(loader.store_enable),
            self.running.eq(loader.running),
        ]

    def _branch(self, m: Module, store: ControlStore) -> BranchUnit:
        branch = BranchUnit(self._core)
        m.submodules.branch_unit = branch
        m.d.comb += [
            branch.running.eq(self.running),
            branch.opcode.eq(self.opcode),
            branch.target.eq(self.argument_1),
            branch.input_ready.eq(self.DRDY_I),
            branch.output_taken.eq(self.ACK_O),
            store.address_b.eq(branch.pc_next),
            self.pc_current.eq(branch.pc_current),
            self.what_branch.eq(branch.what_branch),
            self.last_clock.eq(branch.last_clock),
        ]
        return branch

    def _exchange(self, m: Module, branch: BranchUnit, a: Signal) -> Value:
        io = IoUnit(self._core)
        m.submodules.io_unit = io
        m.d.comb += [
            io.opcode.eq(self.opcode),
            io.element.eq(self.argument_2),
            io.last_clock.eq(branch.last_clock),
            io.source.eq(a),
            self.ACK_I.eq(io.ack_i),
            self.DRDY_O.eq(io.drdy_o),
            self.data_out.eq(io.data_out),
        ]
        return io.chosen

    def _alu(self, m: Module, branch: BranchUnit, chosen: Value) -> Alu | FloatAlu:
        if not self._core.floating:
            m.submodules.alu = fixed = Alu(self._core)
            m.d.comb += fixed.chosen.eq(chosen)
            return fixed
        m.submodules.alu = floats = FloatAlu(self._core)
        third_is_fetched = (branch.what_branch == 2) & branch.second_clock
        m.d.comb += floats.start.eq(self.running & branch.first_round & third_is_fetched)
        return floats

    def _write_back(self, m: Module, data: DataStore, alu: Alu | FloatAlu) -> None:
        reads = self.opcode == Opcode.READ.value
        given = taken(m, self._core, self.data_in)
        for element in range(self._core.elements):
            chosen = stores(self._core, self.opcode, self.argument_2, element)
            m.d.comb += [
                self.written_elements[element].eq(self.last_clock & chosen),
                self.written[element].eq(Mux(reads, given, alu.result[element])),
            ]
        m.d.comb += [data.enable.eq(self.written_elements), data.written.eq(self.written)]
        with m.If(self.last_clock):
            m.d.sync += self.saturated.eq(self.saturated | alu.outside)
