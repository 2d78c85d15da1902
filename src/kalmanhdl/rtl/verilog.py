"""From a component to text: RTLIL for Yosys, and the header of the Verilog."""

import re
from collections.abc import Iterator
from dataclasses import replace
from unittest.mock import patch

from amaranth.back import rtlil
from amaranth.hdl._nir import Netlist
from amaranth.lib.wiring import Component

from kalmanhdl import __version__
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.design import Streams
from kalmanhdl.rtl.context import banks
from kalmanhdl.rtl.datapath import result_cycle
from kalmanhdl.rtl.interface import Command, Interface, Port, interface
from kalmanhdl.schedule.plan import Plan

# Cells say how they read their operands. Yosys repeats the wires' own sign in Verilog, where two signed
# operands make an unsigned addition a signed one: with the sign left off, its Verilog means the cells.
_SIGN_OF_WIRE = re.compile(r"^(\s*wire [^\\$]*)signed (?=[\\$])", re.MULTILINE)

_RESET = """\
Reset (rst, synchronous, high) drops the steps that are on the way and leaves the tracks' states, which start
at zero: set a track up with the command initialise. A stream transfers in a cycle in which valid and ready
are both high. Results come in the order of the steps."""

_LICENCE = """\
This text was generated from the design. It belongs to the user of the generator: no licence of kalmanhdl
applies to it."""


def to_rtlil(component: Component, name: str) -> str:
    """The RTLIL text of a component, its top module called ``name``. No source paths are in it."""
    # Amaranth looks for loops along every bit of every operand, which takes minutes for a long divider.
    # Plans have none, and the simulator that verifies the Verilog refuses one.
    with patch.object(Netlist, "check_comb_cycles", _unchecked):
        text = str(rtlil.convert(component, name=name, emit_src=False))
    return _SIGN_OF_WIRE.sub(r"\1", text)


def _unchecked(_: Netlist) -> None:
    pass


def header(plan: Plan, name: str, lanes: int = 1, streams: Streams = Streams.ONE) -> str:
    """What stands at the top of a design's Verilog, without comment marks: what made it, how it is used.

    Equal plans give equal headers: neither dates nor places are in it.
    """
    shown = interface(plan, lanes, streams)
    lines = [
        f"{name}: a Kalman filter made by kalmanhdl {__version__}",
        "",
        *_lanes(plan, shown),
        *_rate(plan),
        "",
        "In: in_valid, in_ready,",
        *_tag("in", plan, shown),
        *(_port(port, plan) for port in (*shown.numbers, *shown.present)),
        "Out: out_valid, out_ready,",
        *_tag("out", plan, shown),
        *(_port(port, plan) for port in shown.outputs),
        *_loading(plan, shown),
        "",
        *_RESET.splitlines(),
        "",
        "For simulation: while the second wire is high, the first is a new state, of the track on the third.",
        *(["Each lane has its own."] if shown.lanes > 1 else []),
        *(f"  {_columns(write.data, write.enable, write.track or '')}" for write in shown.states),
        "",
        *_LICENCE.splitlines(),
    ]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _loading(plan: Plan, shown: Interface) -> Iterator[str]:
    if not shown.coefficients:
        return
    yield ""
    yield "Coefficients: coefficient_data is stored at coefficient_address in a clock in which"
    yield "coefficient_write is high; no step is taken in it. They begin as those of the design's own model."
    for address, port in enumerate(shown.coefficients):
        yield _port(replace(port, name=f"  address {address}"), plan)


def _lanes(plan: Plan, shown: Interface) -> Iterator[str]:
    if shown.lanes == 1:
        return
    yield f"Lanes: {shown.lanes}, each a filter with tracks of its own, to which the next lines belong."
    if shown.lane_width:
        yield f"They share the streams: the low {shown.lane_width} bits of a track's id are its lane, the"
        yield "others its number there."
    else:
        first, last = (f"{pair}in_valid" for pair in (shown.streams[0], shown.streams[-1]))
        yield f"Each has streams of its own, with the lane before the names of ports: {first} to {last}."


def _rate(plan: Plan) -> Iterator[str]:
    yield f"Tracks: {plan.channels}. Clock cycles between the starts of steps: {plan.interval};"
    yield f"of two steps of one track: {plan.distance}; from start to result: {result_cycle(plan) + 1}."
    kind = "registers" if plan.channels == 1 else "memories"
    places = ", ".join(f"{bank.read_cycle} to {bank.write_cycle}" for bank in banks(plan))
    if places:
        yield f"States are kept in {kind}, read and then written in these cycles of a step: {places}."


def _tag(stream: str, plan: Plan, shown: Interface) -> Iterator[str]:
    if shown.track_width:
        most = shown.track_id(shown.lanes * plan.channels - 1)
        yield f"  {_columns(f'{stream}_track', f'u{shown.track_width}', f'0 to {most}')}"
    codes = ", ".join(f"{command.value} {command.name.lower()}" for command in Command)
    yield f"  {_columns(f'{stream}_command', 'u2', f'{codes}, 3 as {Command.PREDICT.value}')}"


def _port(port: Port, plan: Plan) -> str:
    if port.form is None:
        return f"  {_columns(port.name, 'u1', port.signal)}"
    if isinstance(port.form, Float):
        return f"  {_columns(port.name, f'u{port.width}', f'{port.signal}, {port.form}')}"
    kind = f"{'s' if port.signed else 'u'}{port.width}"
    scale = plan.typed.scales.get(port.signal, 1.0)
    # float() of an exact power of two times the scale: the same text on every machine.
    step = float(port.form.resolution) * scale
    return f"  {_columns(port.name, kind, f'{port.signal}, {port.form}, last bit = {step!r}')}"


def _columns(name: str, kind: str, meaning: str) -> str:
    return f"{name:<24} {kind:<24} {meaning}" if len(kind) > 4 else f"{name:<24} {kind:<4} {meaning}"
