"""The Amaranth shapes of formats and of the payloads of the streams."""

from amaranth import Shape, signed, unsigned
from amaranth.lib.data import StructLayout

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.interface import COMMAND_WIDTH, Interface


def shape(form: Fixed | Float | None) -> Shape:
    """The shape of the raw integers of a format; one bit for a flag."""
    if form is None:
        return unsigned(1)
    if isinstance(form, Float):
        return unsigned(form.width)
    return signed(form.width) if form.signed else unsigned(form.width)


def step_layout(interface: Interface) -> StructLayout:
    """One step to be run: track, command, measurements and controls, what is present."""
    ports = (*interface.numbers, *interface.present)
    return StructLayout(_tag(interface) | {port.field: shape(port.form) for port in ports})


def result_layout(interface: Interface) -> StructLayout:
    """What a step puts out: track, command, outputs."""
    return StructLayout(_tag(interface) | {port.field: shape(port.form) for port in interface.outputs})


def _tag(interface: Interface) -> dict[str, Shape]:
    track = {"track": unsigned(interface.track_width)} if interface.track_width else {}
    return track | {"command": unsigned(COMMAND_WIDTH)}
