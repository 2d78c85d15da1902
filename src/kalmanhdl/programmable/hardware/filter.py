"""A programmable filter as one component: streams, the control store, the datapath that it leads."""

from amaranth.hdl import Module, Shape, Signal, Value, signed, unsigned
from amaranth.lib import wiring
from amaranth.lib.data import StructLayout
from amaranth.lib.wiring import In, Out

from kalmanhdl.programmable.control import HEADER, Layout
from kalmanhdl.programmable.hardware.control_store import ControlStore
from kalmanhdl.programmable.hardware.datapath import ProgrammableDatapath
from kalmanhdl.programmable.image import Image
from kalmanhdl.programmable.interface import (
    COMMITTED,
    SATURATED,
    Port,
    loading_widths,
    ports_in,
    ports_out,
)
from kalmanhdl.rtl.flow import SkidBuffer
from kalmanhdl.rtl.interface import Command
from kalmanhdl.rtl.names import identifier


class ProgrammableFilter(wiring.Component):
    """The hardware of a shape, which begins with an image and takes others.

    Steps run one after the other: one begins when the one before it has ended and its result, where it still
    stands at the exit, is taken. What a step writes counts when it ends: one that reset drops leaves the
    states as they were. ``store_write`` stores ``store_data`` at ``store_address`` of an image.
    """

    def __init__(self, image: Image) -> None:
        self._image, self._layout, self._shape = image, Layout(image.shape), image.shape
        self._in, self._out = ports_in(image.shape), ports_out(image.shape)
        super().__init__(
            {
                "in_valid": In(1),
                "in_ready": Out(1),
                **{port.name: In(_shape(port)) for port in self._in},
                **{name: In(width) for name, width in loading_widths(image.shape)},
                "out_valid": Out(1),
                "out_ready": In(1),
                **{port.name: Out(_shape(port)) for port in self._out},
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        entrance = self._entrance(m)
        m.submodules.store = store = ControlStore(self._layout, self._image.rows)
        m.submodules.datapath = datapath = ProgrammableDatapath(self._layout, self._image)
        busy, offered = Signal(), Signal()
        m.d.comb += [
            store.begin.eq(entrance.o.valid & ~busy & (~offered | self.out_ready)),
            entrance.o.ready.eq(store.begin),
            *(datapath.row.eq(store.row), datapath.active.eq(store.active)),
            self.out_valid.eq(offered),
        ]
        m.d.sync += [
            busy.eq((busy & ~store.last) | store.begin),
            offered.eq((offered & ~self.out_ready) | store.last),
        ]
        self._step(m, entrance, store, datapath)
        self._kept(m, store, datapath)
        self._load(m, store, datapath)
        return m

    def _entrance(self, m: Module) -> SkidBuffer:
        layout = StructLayout({port.name: _shape(port) for port in self._in})
        m.submodules.entrance = entrance = SkidBuffer(layout)
        # What comes with a word of an image is no step.
        m.d.comb += [
            entrance.i.valid.eq(self.in_valid & ~self.store_write),
            self.in_ready.eq(entrance.i.ready),
            *(entrance.i.payload[port.name].eq(getattr(self, port.name)) for port in self._in),
        ]
        return entrance

    def _step(
        self, m: Module, entrance: SkidBuffer, store: ControlStore, datapath: ProgrammableDatapath
    ) -> None:
        """The step that runs, in registers from its beginning on."""
        step = Signal(entrance.o.payload.shape(), reset_less=True)
        with m.If(store.begin):
            m.d.sync += step.eq(entrance.o.payload)
        command = step.in_command
        initialise = Signal()
        m.d.comb += initialise.eq(command == Command.INITIALISE)
        measures = initialise | (command == Command.UPDATE)
        m.d.comb += [datapath.initialise.eq(initialise), datapath.in_initialise.eq(initialise)]
        for port in self._in[1:]:
            value = step[port.name]
            given = value & measures if port.width == 1 else value
            m.d.comb += getattr(datapath, f"in_{identifier(port.signal)}").eq(given)
        held = Signal.like(self.out_command, reset_less=True)
        with m.If(store.last):
            m.d.sync += held.eq(command)
        m.d.comb += self.out_command.eq(held)
        for port in self._out[1:-1]:
            m.d.comb += getattr(self, port.name).eq(getattr(datapath, identifier(port.signal)))

    def _kept(self, m: Module, store: ControlStore, datapath: ProgrammableDatapath) -> None:
        """What is kept from step to step beside the files: which bank counts, and whether a value left."""
        bank, saturated, so_far = Signal(reset_less=True), Signal(reset_less=True), Signal(reset_less=True)
        ends = Signal(name=COMMITTED, attrs={"keep": 1})
        begun = Signal()
        m.d.comb += [ends.eq(store.last), datapath.bank.eq(bank)]
        m.d.sync += begun.eq(store.begin)
        with m.If(begun):
            m.d.sync += so_far.eq(saturated & ~datapath.initialise)
        with m.Elif(datapath.left):
            m.d.sync += so_far.eq(1)
        with m.If(ends):
            m.d.sync += [bank.eq(~bank), saturated.eq(so_far | datapath.left)]
        with m.If(store.load_last):
            m.d.sync += [bank.eq(0), saturated.eq(0)]
        m.d.comb += getattr(self, f"out_{SATURATED}").eq(saturated)

    def _load(self, m: Module, store: ControlStore, datapath: ProgrammableDatapath) -> None:
        bits = self._layout.index_bits
        index, section = self.store_address[:bits], self.store_address[bits:]

        def here(number: int) -> Value:
            return self.store_write & (section == number)

        chunks, files = range(len(self._layout.chunk_widths)), self._shape.files
        m.d.comb += [
            *(store.place.eq(index), store.data.eq(self.store_data)),
            *(datapath.load_place.eq(index), datapath.data.eq(self.store_data)),
            store.load_last.eq(here(HEADER)),
            *(store.load[k].eq(here(self._layout.chunk_section(k))) for k in chunks),
            *(datapath.load[k].eq(here(self._layout.file_section(file))) for k, file in enumerate(files)),
        ]


def _shape(port: Port) -> Shape:
    return signed(port.width) if port.is_signed else unsigned(port.width)
