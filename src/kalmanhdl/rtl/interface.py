"""What the generated module looks like from outside, as plain data.

Whoever drives the hardware (verification, host driver, header of the Verilog) reads the names, widths
and formats of its ports here; nothing in this module needs Amaranth.
"""

import re
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.design import Streams
from kalmanhdl.graph.operations import Coefficient, Flag, Input, is_flag
from kalmanhdl.rtl.names import identifier
from kalmanhdl.schedule.plan import Plan

INITIALISE_FLAG = "initialise"

Number = TypeVar("Number", int, NDArray[np.int64])


class Command(IntEnum):
    """What a step does. The fourth code, 3, is a prediction as well."""

    INITIALISE = 0
    PREDICT = 1
    UPDATE = 2


COMMAND_WIDTH = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """One number or flag of a stream: ``field`` without and ``name`` with the prefix of its stream.

    ``signal`` is its name in the graph, such as ``z[0]``; ``form`` is None for a flag.
    """

    name: str
    field: str
    signal: str
    form: Fixed | Float | None

    @property
    def width(self) -> int:
        """Bits of the port."""
        return self.form.width if self.form else 1

    @property
    def signed(self) -> bool:
        """Whether the bits are in two's complement."""
        return isinstance(self.form, Fixed) and self.form.signed


@dataclass(frozen=True, slots=True, kw_only=True)
class StateWrite:
    """Where a new value of a state can be watched in simulation.

    In every clock cycle in which the wire ``enable`` of the top module is high, the wire ``data`` holds
    the new value of the state for the track on the wire ``track`` (None: there is one track). The wires
    carry the attribute ``keep``; the steps of a track appear in the order in which they were accepted.
    """

    state: str
    data: str
    enable: str
    track: str | None
    form: Fixed | Float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Interface:
    """The ports of a filter beside ``clk`` and ``rst``, and the wires that show its states.

    Streams transfer in a cycle in which both valid and ready are high: in ``in_valid``, ``in_ready``,
    ``in_track`` (if ``track_width``), ``in_command``, ``numbers`` and ``present``; out ``out_valid``,
    ``out_ready``, ``out_track``, ``out_command`` and ``outputs``.

    ``coefficients`` are written through ``coefficient_write``, ``coefficient_address`` and
    ``coefficient_data``: the k-th has the address k, its raw integer stands in the low bits of the data.

    With several lanes the track of number t lives in lane t mod ``lanes`` as its track t div ``lanes``.
    ``streams`` has the prefix that the ports of each pair of streams have, ``scopes`` the prefix of the
    wires of each lane. Where lanes share the streams, the low ``lane_width`` bits of a track id are the lane.
    """

    track_width: int
    numbers: tuple[Port, ...]
    present: tuple[Port, ...]
    outputs: tuple[Port, ...]
    states: tuple[StateWrite, ...]
    lanes: int = 1
    lane_width: int = 0
    coefficients: tuple[Port, ...] = ()
    streams: tuple[str, ...] = ("",)
    scopes: tuple[str, ...] = ("",)

    @property
    def loading(self) -> tuple[tuple[str, int], ...]:
        """The ports by which coefficients are written, each with its width; none without any."""
        if not self.coefficients:
            return ()
        address = max(1, (len(self.coefficients) - 1).bit_length())
        data = max(port.width for port in self.coefficients)
        return ("coefficient_write", 1), ("coefficient_address", address), ("coefficient_data", data)

    def track_id(self, track: Number) -> Number:
        """What a stream calls the track of this number, or of these numbers."""
        local, lane = track // self.lanes, track % self.lanes
        return (local << self.lane_width) | lane if self.lane_width else local


def lane_name(lane: int) -> str:
    """The name of a lane inside its design."""
    return f"lane_{lane}"


def interface(plan: Plan, lanes: int = 1, streams: Streams = Streams.ONE) -> Interface:
    """The interface of ``lanes`` filters of a plan."""
    one = _of_one(plan)
    if lanes == 1:
        return one
    names = [lane_name(lane) for lane in range(lanes)]
    scopes = tuple(f"{name}." for name in names)
    if streams is Streams.LANE:
        return replace(one, lanes=lanes, scopes=scopes, streams=tuple(f"{name}_" for name in names))
    bits = track_width(lanes)
    return replace(one, lanes=lanes, scopes=scopes, lane_width=bits, track_width=one.track_width + bits)


def _of_one(plan: Plan) -> Interface:
    """The interface of one filter. Ports are sorted: z before u, each by its index."""
    operations = plan.typed.graph.operations
    inputs = {o.name: plan.typed.formats[k] for k, o in enumerate(operations) if isinstance(o, Input)}
    kept = {o.name for o in operations if isinstance(o, Coefficient)}
    numbers = [name for name in sorted(inputs, key=_input_order) if name not in kept]
    flags = {o.name for o in operations if isinstance(o, Flag)} - {INITIALISE_FLAG}
    return Interface(
        track_width=track_width(plan.channels),
        numbers=tuple(_port("in", identifier(name), name, inputs[name]) for name in numbers),
        present=tuple(_port("in", _present(name), name, None) for name in sorted(flags, key=_input_order)),
        outputs=tuple(
            _port("out", identifier(name), name, _form(plan, index))
            for name, index in plan.typed.graph.outputs
        ),
        coefficients=tuple(
            _port("in", identifier(name), name, inputs[name]) for name in sorted(kept, key=_input_order)
        ),
        states=tuple(_state_write(plan, name, index) for name, index in plan.typed.graph.states),
    )


def track_width(channels: int) -> int:
    """Bits of a track id: none for one track."""
    return (channels - 1).bit_length()


def _port(stream: str, field: str, signal: str, form: Fixed | Float | None) -> Port:
    return Port(name=f"{stream}_{field}", field=field, signal=signal, form=form)


def _present(flag: str) -> str:
    # in_valid is the handshake; a measurement that came is present.
    return identifier(re.sub(r"^valid\b", "present", flag))


def _form(plan: Plan, index: int) -> Fixed | Float | None:
    return None if is_flag(plan.typed.graph.operations[index]) else plan.typed.formats[index]


def _state_write(plan: Plan, name: str, index: int) -> StateWrite:
    cycle = plan.end(index)
    return StateWrite(
        state=name,
        data=f"context_write_{identifier(name)}",
        enable=f"context_write_enable_c{cycle}",
        track=f"context_write_track_c{cycle}" if plan.channels > 1 else None,
        form=_form(plan, index),
    )


def _input_order(name: str) -> tuple[bool, str, tuple[int, ...]]:
    letters = re.match(r"[^\[]*", name)
    word = letters.group() if letters else name
    return word != "z", word, tuple(int(digits) for digits in re.findall(r"\d+", name))
