"""The control store: rows that an image writes, chunk by chunk, and a counter that goes through them."""

from amaranth.hdl import Cat, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from kalmanhdl.programmable.control import Layout


class ControlStore(wiring.Component):
    """After ``begin`` the rows from 0 to the last one are on ``row``, one a clock; ``active`` tells of them.

    The first is there three clocks after ``begin``, in the clock of the last ``last`` is high. ``load[k]``
    writes chunk k of the row at ``place``, ``load_last`` says which row is the last.
    """

    def __init__(self, layout: Layout, rows: tuple[int, ...]) -> None:
        self._layout, self._rows = layout, rows
        bits = (layout.shape.rows - 1).bit_length()
        super().__init__(
            {
                "begin": In(1),
                "active": Out(1),
                "last": Out(1),
                "row": Out(layout.row_bits),
                "load": In(len(layout.chunk_widths)),
                "load_last": In(1),
                "place": In(bits),
                "data": In(layout.shape.word_width),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        address = Signal(len(self.place), reset_less=True)
        end = Signal(len(self.place), init=len(self._rows) - 1, reset_less=True)
        counting, reading, active = Signal(), Signal(), Signal()
        at_end, ended, last = Signal(), Signal(), Signal()
        m.d.comb += at_end.eq(counting & (address == end))
        with m.If(self.load_last):
            m.d.sync += end.eq(self.data)
        m.d.sync += [
            address.eq(address + 1),
            counting.eq((counting & ~at_end) | self.begin),
            *(reading.eq(counting), ended.eq(at_end)),
            *(active.eq(reading), last.eq(ended)),
        ]
        with m.If(self.begin):
            m.d.sync += address.eq(0)
        row = Signal(self._layout.row_bits, reset_less=True)
        m.d.sync += row.eq(self._words(m, address))
        m.d.comb += [self.row.eq(row), self.active.eq(active), self.last.eq(last)]
        return m

    def _words(self, m: Module, address: Signal) -> Value:
        """The row at an address, a clock later."""
        found, chunks = [], [self._layout.chunks(row) for row in self._rows]
        for k, width in enumerate(self._layout.chunk_widths):
            words = [chunk[k] for chunk in chunks]
            memory = Memory(shape=width, depth=self._layout.shape.rows, init=words, attrs={"no_rw_check": 1})
            m.submodules[f"chunk_{k}"] = memory
            write, read = memory.write_port(), memory.read_port()
            m.d.comb += [
                write.en.eq(self.load[k]),
                write.addr.eq(self.place),
                write.data.eq(self.data),
                read.addr.eq(address),
            ]
            found.append(read.data)
        return Cat(*found)
