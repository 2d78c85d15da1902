"""The pipelined controller: fetch, operands, execute and write back of different instructions at once."""

from amaranth.hdl import Module, Mux, ResetSignal, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.control_store import ControlStore
from kalmanhdl.processor.hardware.data_store import DataStore
from kalmanhdl.processor.hardware.decoding import stores
from kalmanhdl.processor.hardware.element_unit import ElementUnit
from kalmanhdl.processor.hardware.fetch_unit import FetchUnit
from kalmanhdl.processor.hardware.float_array import FloatArray
from kalmanhdl.processor.hardware.io_queues import IoQueues
from kalmanhdl.processor.hardware.layouts import matrix_layout, taken, word_shape
from kalmanhdl.processor.hardware.loader import Loader
from kalmanhdl.processor.hardware.operands import second_operands
from kalmanhdl.processor.hardware.product_array import ProductArray
from kalmanhdl.processor.hardware.results import chosen_results
from kalmanhdl.processor.hardware.scoreboard import Scoreboard
from kalmanhdl.processor.instructions import OPCODE_BITS, WORD_BITS, Opcode


class PipelinedController(wiring.Component):
    """A core whose instructions overlap, with the ports of the paper's: ``clocks.Overlapping`` is its time.

    After a reset it takes a program (the ports ``program_*``) and runs it. ``saturated`` says that a result
    since the reset did not fit its format. The last ports are looks inside and may stay open: ``issued``, the
    instruction of ``opcode`` at ``pc_current`` takes effect; ``written`` goes to the ``written_elements`` of
    the matrix ``written_matrix``.
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
                "issued": Out(1),
                "pc_current": Out(core.program_bits),
                "opcode": Out(OPCODE_BITS),
                "written_matrix": Out(core.address_bits),
                "written_elements": Out(core.elements),
                "written": Out(matrix_layout(core)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = self._core
        m.submodules.control_store = store = ControlStore(core)
        m.submodules.loader = loader = Loader(core)
        m.submodules.fetch_unit = fetch = FetchUnit(core)
        m.submodules.scoreboard = board = Scoreboard(core)
        m.submodules.io_queues = queues = IoQueues(core)
        m.submodules.data_store = data = DataStore(core, reads=3 if core.extended else 2)
        m.submodules.product_array = array = FloatArray(core) if core.floating else ProductArray(core)
        m.submodules.element_unit = unit = ElementUnit(core)
        self._load(m, loader, store)
        m.d.comb += [
            fetch.running.eq(loader.running),
            fetch.word.eq(store.word_b),
            store.address_b.eq(fetch.store_address),
            self.pc_current.eq(fetch.pc_current),
            self.opcode.eq(fetch.opcode),
            self.issued.eq(fetch.issued),
        ]
        self._exchange(m, fetch, queues, unit)
        self._hold_back(m, fetch, board, queues)
        m.d.comb += [board.array_left.eq(array.left), array.start.eq(board.starts)]
        for address, argument in zip(data.addresses, fetch.ahead, strict=False):
            m.d.comb += address.eq(argument)
        operands = self._operands(fetch, board, data)
        self._execute(m, fetch, operands, array, unit)
        self._write_back(m, board, data, array, unit)
        return m

    def _load(self, m: Module, loader: Loader, store: ControlStore) -> None:
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

    def _exchange(self, m: Module, fetch: FetchUnit, queues: IoQueues, unit: ElementUnit) -> None:
        core = self._core
        writes = Signal()
        m.d.sync += writes.eq(fetch.issued & (fetch.opcode == Opcode.WRITE.value))
        m.d.comb += [
            queues.data_in.eq(taken(m, core, self.data_in)),
            queues.drdy_i.eq(self.DRDY_I),
            self.ACK_I.eq(queues.ack_i),
            self.data_out.eq(queues.data_out),
            self.DRDY_O.eq(queues.drdy_o),
            queues.ack_o.eq(self.ACK_O),
            queues.read.eq(fetch.issued & (fetch.opcode == Opcode.READ.value)),
            queues.write.eq(writes),
            queues.written.eq(unit.chosen),
            unit.incoming.eq(queues.first),
            fetch.input_ready.eq(queues.available),
            fetch.output_taken.eq(queues.room),
        ]

    def _hold_back(self, m: Module, fetch: FetchUnit, board: Scoreboard, queues: IoQueues) -> None:
        starved = (fetch.opcode == Opcode.READ.value) & ~queues.available
        crowded = (fetch.opcode == Opcode.WRITE.value) & ~queues.room
        m.d.comb += [
            board.opcode.eq(fetch.opcode),
            board.issued.eq(fetch.issued),
            fetch.blocked.eq(board.blocked | starved | crowded),
        ]
        for argument, of in zip(board.arguments, fetch.arguments, strict=True):
            m.d.comb += argument.eq(of)

    def _operands(self, fetch: FetchUnit, board: Scoreboard, data: DataStore) -> list[list[Value]]:
        """The matrices at the arguments, with what is stored in this clock."""
        core, stored = self._core, board.stored
        found = []
        for argument, read in zip(fetch.arguments, data.read, strict=False):
            same = stored.valid & (stored.matrix == argument[: core.address_bits])
            found.append(
                [
                    Mux(same & stores(core, stored.opcode, stored.element, e), self.written[e], read[e])
                    for e in range(core.elements)
                ]
            )
        return found

    def _execute(
        self,
        m: Module,
        fetch: FetchUnit,
        operands: list[list[Value]],
        array: ProductArray | FloatArray,
        unit: ElementUnit,
    ) -> None:
        core = self._core
        fetched = Signal(matrix_layout(core))
        m.d.comb += [fetched[e].eq(operands[1][e]) for e in range(core.elements)]
        exponent = fetch.arguments[1].as_signed()
        second = second_operands(m, core, fetch.opcode, exponent, fetched)
        m.d.comb += [array.opcode.eq(fetch.opcode), unit.opcode.eq(fetch.opcode)]
        m.d.comb += unit.element.eq(fetch.arguments[1])
        for e in range(core.elements):
            m.d.comb += [
                array.a[e].eq(operands[0][e]),
                array.b[e].eq(second[e]),
                unit.a[e].eq(operands[0][e]),
                unit.b[e].eq(fetched[e]),
            ]
            if core.extended:
                m.d.comb += array.c[e].eq(operands[2][e])

    def _write_back(
        self,
        m: Module,
        board: Scoreboard,
        data: DataStore,
        array: ProductArray | FloatArray,
        unit: ElementUnit,
    ) -> None:
        core, stored = self._core, board.stored
        if core.functions:
            m.d.comb += unit.function.eq(stored.element)
        results = (*array.results, *unit.results)
        values, outside = chosen_results(core, stored.opcode, unit.result_of_most, results)
        for e, value in enumerate(values):
            m.d.comb += [
                self.written[e].eq(value),
                # What a reset finds on its way is lost.
                self.written_elements[e].eq(
                    stored.valid & stores(core, stored.opcode, stored.element, e) & ~ResetSignal()
                ),
            ]
        m.d.comb += [self.written_matrix.eq(stored.matrix), data.write_address.eq(stored.matrix)]
        m.d.comb += [data.enable.eq(self.written_elements), data.written.eq(self.written)]
        with m.If(stored.valid):
            m.d.sync += self.saturated.eq(self.saturated | outside)
