"""The Verilog of a shape's hardware, which begins with an image."""

from collections.abc import Iterator

from kalmanhdl import __version__
from kalmanhdl.programmable.control import Layout
from kalmanhdl.programmable.image import Image
from kalmanhdl.programmable.interface import Port, loading_widths, ports_in, ports_out
from kalmanhdl.shape import Shape

_LOADED = """\
An image is a filter: store_data is stored at store_address in a clock in which store_write is high; no step
is taken in it, and none may be on the way. The image that the hardware begins with is that of its design.
Reset (rst, synchronous, high) drops the step that is on the way, which leaves the states as they were."""

_LICENCE = """\
This text was generated from the design. It belongs to the user of the generator: no licence of kalmanhdl
applies to it."""


def verilog_of(name: str, image: Image) -> str:
    """The Verilog text, the same for equal images. Raises ToolError."""
    # Amaranth takes long to import; who only makes images does not need it.
    from kalmanhdl.programmable.hardware.filter import ProgrammableFilter
    from kalmanhdl.rtl.verilog import to_rtlil
    from kalmanhdl.toolchain.yosys import rtlil_to_verilog

    rtlil = to_rtlil(ProgrammableFilter(image), name)
    return rtlil_to_verilog(rtlil, name, "\n".join(_header(name, image.shape)) + "\n")


def _header(name: str, shape: Shape) -> Iterator[str]:
    layout = Layout(shape)
    yield f"{name}: a programmable Kalman filter made by kalmanhdl {__version__}"
    yield ""
    counts = ", ".join(f"{count} {kind}" for kind, count in shape.units.items())
    yield f"Units: {counts}. Rows of control: {shape.rows}, of {layout.row_bits} bits each."
    yield f"Words of {shape.word_width} bits, {shape.words} in each of {len(shape.files)} files."
    yield ""
    yield "In: in_valid, in_ready,"
    yield from (_port(port) for port in ports_in(shape))
    yield "Out: out_valid, out_ready,"
    yield from (_port(port) for port in ports_out(shape))
    yield "Image:"
    yield from (f"  {word:<24} u{width}" for word, width in loading_widths(shape))
    yield ""
    yield from (*_LOADED.splitlines(), "", *_LICENCE.splitlines())


def _port(port: Port) -> str:
    return f"  {port.name:<24} {'s' if port.is_signed else 'u'}{port.width:<3} {port.signal}"
