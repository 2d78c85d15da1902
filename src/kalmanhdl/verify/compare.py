"""Verilog and engine, bit for bit: every output and every state of every step."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import VerificationError
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.interface import COMMAND_WIDTH, Interface
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.limbs import Integers, from_limbs, to_limbs
from kalmanhdl.toolchain.cxxrtl import Border, Stream, Watch
from kalmanhdl.toolchain.simulation import Simulation, Stalls, Trace
from kalmanhdl.verify.stimulus import Steps

Words = NDArray[np.uint64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """A run of the Verilog beside the engine without a difference."""

    simulator: str
    stimulus: str
    steps: int
    bits: int
    cycles: int
    cycles_per_second: float
    mismatches: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Mismatch:
    """The first difference: the step in sending order, its track, the signal and both raw values."""

    step: int
    track: int
    signal: str
    verilog: int
    engine: int


def border_of(interface: Interface) -> Border:
    """The streams of the generated module, and its states as watches."""
    tag = [("command", COMMAND_WIDTH)] + ([("track", interface.track_width)] if interface.track_width else [])
    into = [*((f"in_{n}", w) for n, w in tag), *((p.name, p.width) for p in _inputs(interface))]
    out = [*((f"out_{n}", w) for n, w in tag), *((p.name, p.width) for p in interface.outputs)]
    groups: dict[str, list[tuple[str, int]]] = {}
    for state in interface.states:
        wires = groups.setdefault(state.enable, [(state.track, interface.track_width)] if state.track else [])
        wires.append((state.data, state.form.width if state.form else 1))
    return Border(
        source=Stream(valid="in_valid", ready="in_ready", payload=tuple(into)),
        sink=Stream(valid="out_valid", ready="out_ready", payload=tuple(out)),
        watches=tuple(Watch(enable=enable, wires=tuple(wires)) for enable, wires in groups.items()),
    )


def _inputs(interface: Interface) -> tuple:  # type: ignore[type-arg]
    return (*interface.numbers, *interface.present)


def verify(
    library: Path,
    top: str,
    interface: Interface,
    typed: TypedGraph,
    steps: Steps,
    *,
    stimulus: str,
    stalls: Stalls | None = None,
) -> Verification:
    """Run steps through a compiled simulator of the Verilog and the engine and compare every bit.

    Raises VerificationError at the first difference, or where the Verilog hangs.
    """
    border = border_of(interface)
    expected = Engine.of(typed).run(steps.inputs, steps.flags, active=steps.active)
    tokens = _packed(border, interface, steps)
    begin = time.perf_counter()
    with Simulation(library, border) as simulation:
        trace = simulation.run(tokens, len(steps.order), stalls)
    seconds = time.perf_counter() - begin
    found = _first_mismatch(border, interface, steps, trace, expected.outputs, expected.states)
    if found is not None:
        raise VerificationError(
            f"{top}: step {found.step} (track {found.track}), {found.signal}: the Verilog gives "
            f"{found.verilog}, the engine {found.engine} (raw integers; {stimulus} stimulus)"
        )
    width = sum(w for _, w in border.sink.payload) + sum(
        w for watch in border.watches for _, w in watch.wires
    )
    return Verification(
        simulator="cxxrtl",
        stimulus=stimulus,
        steps=len(steps.order),
        bits=len(steps.order) * width,
        cycles=trace.cycles,
        cycles_per_second=trace.cycles / seconds if seconds else 0.0,
    )


def _packed(border: Border, interface: Interface, steps: Steps) -> Words:
    """One token a step, in sending order."""
    tracks = steps.commands.shape[1]
    fields: dict[str, Integers] = {
        "in_command": steps.commands.ravel()[steps.order],
        "in_track": steps.order % tracks,
    }
    fields |= {port.name: steps.inputs[port.signal].ravel()[steps.order] for port in interface.numbers}
    fields |= {port.name: steps.flags[port.signal].ravel()[steps.order] for port in interface.present}
    return np.concatenate([_words(fields[name], width) for name, width in border.source.payload], axis=1)


def _words(values: Integers, width: int) -> Words:
    if width <= 64:
        mask = np.uint64((1 << width) - 1)
        return (values.astype(np.int64).view(np.uint64) & mask)[:, None]
    limbs = to_limbs(values, -(-width // 64))
    if width % 64:
        limbs[:, -1] &= np.uint64((1 << width % 64) - 1)
    return limbs


def _values(words: Words, width: int, form: Fixed | None) -> Integers:
    """Raw integers from the words of a port."""
    signed = form is not None and form.signed
    if width > 64:
        raws = from_limbs(words)
        return np.where(raws >= 1 << (width - 1), raws - (1 << width), raws) if signed else raws
    raws = words[:, 0].astype(np.int64) if width < 64 else words[:, 0].view(np.int64)
    half = 1 << (width - 1)
    return (raws ^ half) - half if signed and width < 64 else raws


def _columns(words: Words, ports: tuple[tuple[str, int], ...]) -> dict[str, Words]:
    """The words of each port by name."""
    columns, place = {}, 0
    for name, width in ports:
        count = -(-width // 64)
        columns[name] = words[:, place : place + count]
        place += count
    return columns


def _first_mismatch(
    border: Border,
    interface: Interface,
    steps: Steps,
    trace: Trace,
    outputs: dict[str, Integers],
    states: dict[str, Integers],
) -> Mismatch | None:
    found = [_in_outputs(border, interface, steps, trace.outputs, outputs)]
    for watch, records in zip(border.watches, trace.watched, strict=True):
        found.append(_in_states(watch, interface, steps, records, states))
    real = [each for each in found if each is not None]
    return min(real, key=lambda each: each.step) if real else None


def _in_outputs(
    border: Border, interface: Interface, steps: Steps, words: Words, outputs: dict[str, Integers]
) -> Mismatch | None:
    columns = _columns(words, border.sink.payload)
    tracks = steps.commands.shape[1]
    found = [
        _difference("out_command", _values(columns["out_command"], 2, None), steps.commands.ravel(), steps)
    ]
    if "out_track" in columns:
        place = np.broadcast_to(np.arange(tracks), steps.commands.shape).ravel()
        width = interface.track_width
        found.append(_difference("out_track", _values(columns["out_track"], width, None), place, steps))
    for port in interface.outputs:
        seen = _values(columns[port.name], port.width, port.form)
        found.append(_difference(port.signal, seen, outputs[port.signal].ravel(), steps))
    real = [each for each in found if each is not None]
    return min(real, key=lambda each: each.step) if real else None


def _in_states(
    watch: Watch, interface: Interface, steps: Steps, records: Words, states: dict[str, Integers]
) -> Mismatch | None:
    columns = _columns(records, watch.wires)
    if len(records) != len(steps.order):
        return Mismatch(
            step=min(len(records), len(steps.order) - 1),
            track=-1,
            signal=f"number of writes under {watch.enable}",
            verilog=len(records),
            engine=len(steps.order),
        )
    found = []
    for state in interface.states:
        if state.data in columns:
            width = state.form.width if state.form else 1
            seen = _values(columns[state.data], width, state.form)
            found.append(_difference(f"state {state.state}", seen, states[state.state].ravel(), steps))
        if state.track and state.track in columns:
            place = steps.order % steps.commands.shape[1]
            seen = _values(columns[state.track], interface.track_width, None)
            if not np.array_equal(seen, place):
                at = int(np.flatnonzero(seen != place)[0])
                found.append(
                    Mismatch(
                        step=at,
                        track=int(place[at]),
                        signal=state.track,
                        verilog=int(seen[at]),
                        engine=int(place[at]),
                    )
                )
    real = [each for each in found if each is not None]
    return min(real, key=lambda each: each.step) if real else None


def _difference(signal: str, seen: Integers, expected: Integers, steps: Steps) -> Mismatch | None:
    wanted = expected[steps.order]
    tracks = steps.order % steps.commands.shape[1]
    return _unequal(signal, seen, wanted.astype(np.int64) if wanted.dtype == bool else wanted, tracks)


def _unequal(signal: str, seen: Integers, wanted: Integers, tracks: Integers) -> Mismatch | None:
    unequal = np.flatnonzero(seen != wanted)
    if not len(unequal):
        return None
    at = int(unequal[0])
    return Mismatch(
        step=at, track=int(tracks[at]), signal=signal, verilog=int(seen[at]), engine=int(wanted[at])
    )
