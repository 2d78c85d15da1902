"""A file of operands before a port of a unit: read in every clock, written in every clock."""

from amaranth.hdl import Module, Mux
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from kalmanhdl.shape import Shape


class OperandFile(wiring.Component):
    """The word at ``read`` is on ``word`` a clock later. ``words`` are there from the configuration on.

    ``enable`` writes ``data`` at ``write``; while ``load`` is high, ``loaded`` at ``load_place``. No word is
    read in the clock in which it is written.
    """

    def __init__(self, shape: Shape, file: str, words: tuple[int, ...]) -> None:
        self._depth, self._width = shape.words, shape.file_width(file)
        self._words = words
        bits = (shape.words - 1).bit_length()
        super().__init__(
            {
                "read": In(bits),
                "word": Out(self._width),
                "enable": In(1),
                "write": In(bits),
                "data": In(self._width),
                "load": In(1),
                "load_place": In(bits),
                "loaded": In(self._width),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        mask = (1 << self._width) - 1
        memory = Memory(
            shape=self._width,
            depth=self._depth,
            init=[word & mask for word in self._words],
            # Block RAM is there in plenty, and beyond a flag the LUTs of so many words are not.
            attrs={"no_rw_check": 1, **({"ram_style": "block"} if self._width > 1 else {})},
        )
        m.submodules.memory = memory
        write, read = memory.write_port(), memory.read_port()
        m.d.comb += [
            read.addr.eq(self.read),
            self.word.eq(read.data),
            write.en.eq(self.enable | self.load),
            write.addr.eq(Mux(self.load, self.load_place, self.write)),
            write.data.eq(Mux(self.load, self.loaded, self.data)),
        ]
        return m
