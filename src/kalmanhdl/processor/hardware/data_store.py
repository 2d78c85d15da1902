"""The data store: a bank of memory for every element of a matrix, all driven by the same addresses."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.layouts import bank_name, matrix_layout


class DataStore(wiring.Component):
    """``read[k]`` is the matrix at ``addresses[k]`` of the clock before, with what was stored in that clock.

    ``enable`` has a bit for every bank. With one read the address for writing is the same, and what is stored
    is read a clock later.
    """

    def __init__(self, core: Core, reads: int = 1) -> None:
        self._core, self._reads = core, reads
        super().__init__(
            {
                "addresses": In(core.address_bits).array(reads),
                "write_address": In(core.address_bits),
                "enable": In(core.elements),
                "written": In(matrix_layout(core)),
                "read": Out(matrix_layout(core)).array(reads),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        shape = matrix_layout(self._core).elem_shape
        # Addresses that come late in the clock reach a block a bank, not tables in logic by the hundred.
        attributes = {"ram_style": "block"} if self._reads > 1 else {}
        for element in range(self._core.elements):
            bank = Memory(shape=shape, depth=self._core.matrices, init=[], attrs=attributes)
            m.submodules[bank_name(self._core, element)] = bank
            write = bank.write_port()
            m.d.comb += [
                write.addr.eq(self.write_address),
                write.data.eq(self.written[element]),
                write.en.eq(self.enable[element]),
            ]
            through = [write] if self._reads > 1 else []
            for address, found in zip(self.addresses, self.read, strict=True):
                read = bank.read_port(transparent_for=through)
                m.d.comb += [read.addr.eq(address), found[element].eq(read.data)]
        return m
