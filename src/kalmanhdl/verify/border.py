"""Where a design meets who drives it: its streams, its states as watches, and a step's numbers."""

from dataclasses import replace

import numpy as np

from kalmanhdl.rtl.interface import COMMAND_WIDTH, Interface
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.toolchain.harness import Border, Stream, Watch
from kalmanhdl.verify.stimulus import Steps

RESET = "rst"


def border_of(interface: Interface) -> Border:
    """The streams of the generated module, and its states as watches."""
    first, *further = streams_of(interface)
    source, sink = first
    # A token whose reset bit is set is no step but a reset of one clock.
    source = replace(source, payload=(*source.payload, *interface.loading, (RESET, 1)))
    watches = (watch for scope in interface.scopes for watch in state_watches(interface, scope))
    return Border(source=source, sink=sink, further=tuple(further), watches=tuple(watches))


def streams_of(interface: Interface) -> tuple[tuple[Stream, Stream], ...]:
    """Every stream in with its stream out."""
    return tuple(stream_pair(interface, prefix) for prefix in interface.streams)


def stream_pair(interface: Interface, prefix: str) -> tuple[Stream, Stream]:
    """The streams whose ports have a prefix."""
    tag = [("command", COMMAND_WIDTH)] + ([("track", interface.track_width)] if interface.track_width else [])
    given = (*interface.numbers, *interface.present)
    into = [*((f"in_{n}", w) for n, w in tag), *((p.name, p.width) for p in given)]
    out = [*((f"out_{n}", w) for n, w in tag), *((p.name, p.width) for p in interface.outputs)]
    source, sink = (tuple((prefix + name, width) for name, width in ports) for ports in (into, out))
    return (
        Stream(valid=f"{prefix}in_valid", ready=f"{prefix}in_ready", payload=source),
        Stream(valid=f"{prefix}out_valid", ready=f"{prefix}out_ready", payload=sink),
    )


def state_watches(interface: Interface, scope: str) -> list[Watch]:
    """The states of a lane, those that are written together in one watch; the order is that of every lane."""
    width = interface.track_width - interface.lane_width
    groups: dict[str, list[tuple[str, int]]] = {}
    for state in interface.states:
        wires = groups.setdefault(state.enable, [(scope + state.track, width)] if state.track else [])
        wires.append((scope + state.data, state.form.width if state.form else 1))
    return [Watch(enable=scope + enable, wires=tuple(wires)) for enable, wires in groups.items()]


def tag(steps: Steps, interface: Interface, stream: str) -> dict[str, Integers]:
    """What the ports of a stream ``in`` or ``out`` say of each step, in sending order: command and track."""
    found: dict[str, Integers] = {f"{stream}_command": steps.commands.ravel()[steps.order]}
    if interface.track_width:
        found[f"{stream}_track"] = np.asarray(interface.track_id(steps.tracks))
    return found


def sent_numbers(steps: Steps, interface: Interface) -> dict[str, Integers]:
    """What each port of a stream in carries, in the order of the ports, step by step in sending order."""
    numbers = {port.name: steps.inputs[port.signal].ravel()[steps.order] for port in interface.numbers}
    present = {port.name: steps.offered[port.signal].ravel()[steps.order] for port in interface.present}
    return tag(steps, interface, "in") | numbers | present
