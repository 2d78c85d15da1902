"""Numbers in and out of a pipelined core by handshakes, through queues."""

from amaranth.hdl import Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.layouts import word_shape
from kalmanhdl.processor.timing import QUEUE


class Queue(wiring.Component):
    """First in, first out. ``first`` is there while ``level`` is not zero; ``push`` needs room."""

    def __init__(self, core: Core) -> None:
        word = word_shape(core)
        super().__init__(
            {
                "pushed": In(word),
                "push": In(1),
                "pop": In(1),
                "first": Out(word),
                "level": Out(range(QUEUE + 1)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.memory = memory = Memory(shape=self.pushed.shape(), depth=QUEUE, init=[])
        write, read = memory.write_port(), memory.read_port(domain="comb")
        m.d.comb += [
            write.data.eq(self.pushed),
            write.en.eq(self.push),
            self.first.eq(read.data),
        ]
        for address, moves in ((write.addr, self.push), (read.addr, self.pop)):
            place = Signal(range(QUEUE))
            m.d.comb += address.eq(place)
            m.d.sync += place.eq(place + moves)
        m.d.sync += self.level.eq(self.level + self.push - self.pop)
        return m


class IoQueues(wiring.Component):
    """Takes numbers while there is room, and gives them as they are taken.

    Either strobe stays until it is answered. ``DRDY_I`` with ``ACK_I`` low brings a number; ``ACK_I`` falls
    once ``DRDY_I`` has. ``DRDY_O`` rises while ``ACK_O`` is high and falls once ``ACK_O`` has. ``available``:
    ``first`` can be read; ``room``: a number can be written behind the one that is written in this clock.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        word = word_shape(core)
        super().__init__(
            {
                "data_in": In(word),
                "drdy_i": In(1),
                "ack_i": Out(1),
                "data_out": Out(word),
                "drdy_o": Out(1),
                "ack_o": In(1),
                "read": In(1),
                "first": Out(word),
                "available": Out(1),
                "write": In(1),
                "written": In(word),
                "room": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.coming = coming = Queue(self._core)
        m.submodules.going = going = Queue(self._core)
        takes: Value = self.drdy_i & ~self.ack_i & (coming.level != QUEUE)
        gives: Value = ~self.drdy_o & self.ack_o & (going.level != 0)
        m.d.comb += [
            coming.pushed.eq(self.data_in),
            coming.push.eq(takes),
            coming.pop.eq(self.read),
            self.first.eq(coming.first),
            self.available.eq(coming.level != 0),
            going.pushed.eq(self.written),
            going.push.eq(self.write),
            going.pop.eq(gives),
            self.room.eq(going.level + self.write < QUEUE),
        ]
        m.d.sync += self.ack_i.eq(takes | (self.ack_i & self.drdy_i))
        m.d.sync += self.drdy_o.eq(gives | (self.drdy_o & self.ack_o))
        with m.If(gives):
            m.d.sync += self.data_out.eq(going.first)
        return m
