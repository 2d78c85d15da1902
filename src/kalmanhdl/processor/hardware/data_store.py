"""The data store: a bank of memory for every element of a matrix, all driven by one address."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.layouts import bank_name, matrix_layout


class DataStore(wiring.Component):
    """``read`` is the matrix at the ``address`` of the clock before; ``enable`` has a bit for every bank."""

    def __init__(self, core: Core) -> None:
        self._core = core
        super().__init__(
            {
                "address": In(core.address_bits),
                "enable": In(core.elements),
                "written": In(matrix_layout(core)),
                "read": Out(matrix_layout(core)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        shape = matrix_layout(self._core).elem_shape
        for element in range(self._core.elements):
            bank = Memory(shape=shape, depth=self._core.matrices, init=[])
            m.submodules[bank_name(self._core, element)] = bank
            write, read = bank.write_port(), bank.read_port()
            m.d.comb += [
                write.addr.eq(self.address),
                write.data.eq(self.written[element]),
                write.en.eq(self.enable[element]),
                read.addr.eq(self.address),
                self.read[element].eq(read.data),
            ]
        return m
