"""Verilog and engine, bit for bit: every output and every state of every step."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import VerificationError
from kalmanhdl.rtl.interface import COMMAND_WIDTH, Interface, interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.engine import Trace as EngineTrace
from kalmanhdl.simulate.limbs import Integers, from_limbs, to_limbs
from kalmanhdl.toolchain.cxxrtl import Border, Stream, Watch
from kalmanhdl.toolchain.simulation import Simulation, Trace
from kalmanhdl.verify.stimulus import Section, Steps
from kalmanhdl.verify.timing import accepted_again, handed_over, held_back, never_waits

RESET = "rst"

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

    def __str__(self) -> str:
        return (
            f"step {self.step} (track {self.track}), {self.signal}: the Verilog gives {self.verilog}, "
            f"the engine {self.engine} (raw integers)"
        )


def border_of(interface: Interface) -> Border:
    """The streams of the generated module, and its states as watches."""
    tag = [("command", COMMAND_WIDTH)] + ([("track", interface.track_width)] if interface.track_width else [])
    # A token whose reset bit is set is no step but a reset of one clock.
    into = [*((f"in_{n}", w) for n, w in tag), *((p.name, p.width) for p in _inputs(interface)), (RESET, 1)]
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
    library: Path, top: str, plan: Plan, engine: Engine, sections: Sequence[Section], *, stimulus: str
) -> Verification:
    """Run sections of steps through a compiled simulator of the Verilog and the engine and compare every bit.

    Where nobody pauses, the clock in which each result comes is compared with what the plan says.
    Raises VerificationError at the first difference, or where the Verilog hangs.
    """
    shown = interface(plan)
    border = border_of(shown)
    before: dict[str, Integers] | None = None
    since, seconds = 0, 0.0
    with Simulation(library, border) as simulation:
        for number, section in enumerate(sections):
            steps = section.steps
            expected = engine.run(steps.inputs, steps.flags, active=steps.active, initial_state=before)
            begin = time.perf_counter()
            trace = _simulated(simulation, border, shown, plan, section, reset=number + 1 < len(sections))
            seconds += time.perf_counter() - begin
            found = _first_mismatch(border, shown, section, trace, expected) or _first_late(
                plan, section, trace, since
            )
            if found is not None:
                raise VerificationError(f"{top}: {found} ({stimulus} stimulus)")
            before = _left_behind(border, shown, section, trace, expected, before)
            since = trace.cycles
    width = sum(w for _, w in border.sink.payload) + sum(
        w for watch in border.watches for _, w in watch.wires
    )
    sent = sum(len(section.steps.order) for section in sections)
    return Verification(
        simulator="cxxrtl",
        stimulus=stimulus,
        steps=sent,
        bits=sent * width,
        cycles=since,
        cycles_per_second=since / seconds if seconds else 0.0,
    )


def _simulated(
    simulation: Simulation, border: Border, shown: Interface, plan: Plan, section: Section, *, reset: bool
) -> Trace:
    """The trace of a section, with what is still written in the clock of the reset that ends it."""
    tokens = _packed(border, shown, section.steps)
    count = len(tokens) - section.left
    if section.blocked:
        full = held_back(plan)
        first = simulation.run(tokens[:full], 0)
        second = simulation.run(tokens[full:], count)
        trace = replace(second, accepted_at=np.concatenate([first.accepted_at, second.accepted_at]))
    else:
        trace = simulation.run(tokens, count, section.stalls)
    if not reset:
        return trace
    pulse = np.zeros((1, tokens.shape[1]), np.uint64)
    pulse[0, -1] = 1
    after = simulation.run(pulse, 0)
    watched = tuple(np.concatenate(both) for both in zip(trace.watched, after.watched, strict=True))
    return replace(trace, watched=watched, cycles=after.cycles)


def _first_late(plan: Plan, section: Section, trace: Trace, since: int) -> str | None:
    """What comes in another clock than the plan says, of what it does say; clock 0 is ``since``."""
    tracks = section.steps.tracks
    accepted, produced = trace.accepted_at - since, trace.produced_at - since
    if section.calm:
        seen, wanted, what = produced, handed_over(plan, tracks)[: len(produced)], "has its result"
    elif section.blocked and never_waits(plan):
        seen = accepted[held_back(plan) :][:1]
        wanted, what = np.array([accepted_again(plan, int(produced[0]))]), "is taken"
    else:
        return None
    late = np.flatnonzero(seen != wanted)
    if not len(late):
        return None
    at = int(late[0])
    step = at if section.calm else held_back(plan)
    return (
        f"step {step} (track {tracks[step]}) {what} in clock {seen[at]} after reset, "
        f"and by the schedule in clock {wanted[at]}"
    )


def _left_behind(
    border: Border,
    shown: Interface,
    section: Section,
    trace: Trace,
    expected: EngineTrace,
    before: dict[str, Integers] | None,
) -> dict[str, Integers]:
    """What the tracks' states are after the reset: of steps that were on the way, some states are written."""
    if not section.left:
        return expected.final_state
    written: dict[str, int] = {}
    for watch, records in zip(border.watches, trace.watched, strict=True):
        written |= {name: len(records) for name, _ in watch.wires}
    held = {}
    for state in shown.states:
        states = expected.states[state.state]
        held[state.state] = (
            np.zeros(states.shape[1], states.dtype) if before is None else before[state.state].copy()
        )
        places = section.steps.order[: written[state.data]]
        tracks = section.steps.tracks[: len(places)]
        # The last step of each track.
        _, backwards = np.unique(tracks[::-1], return_index=True)
        last = len(places) - 1 - backwards
        held[state.state][tracks[last]] = states.ravel()[places[last]]
    return held


def _packed(border: Border, interface: Interface, steps: Steps) -> Words:
    """One token a step, in sending order."""
    tracks = steps.commands.shape[1]
    fields: dict[str, Integers] = {
        "in_command": steps.commands.ravel()[steps.order],
        "in_track": steps.order % tracks,
    }
    fields |= {port.name: steps.inputs[port.signal].ravel()[steps.order] for port in interface.numbers}
    fields |= {port.name: steps.offered[port.signal].ravel()[steps.order] for port in interface.present}
    fields[RESET] = np.zeros(len(steps.order), np.int64)
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
    border: Border, interface: Interface, section: Section, trace: Trace, expected: EngineTrace
) -> Mismatch | None:
    found = [_in_outputs(border, interface, section.steps, trace.outputs, expected.outputs)]
    # The simulation keeps no more records than it is given steps, of the second part of a blocked section.
    for watch, records in zip(border.watches, () if section.blocked else trace.watched, strict=False):
        found.append(_in_states(watch, interface, section, records, expected.states))
    real = [each for each in found if each is not None]
    return min(real, key=lambda each: each.step) if real else None


def _in_outputs(
    border: Border, interface: Interface, steps: Steps, words: Words, outputs: dict[str, Integers]
) -> Mismatch | None:
    columns = _columns(words, border.sink.payload)
    found = [
        _difference("out_command", _values(columns["out_command"], 2, None), steps.commands.ravel(), steps)
    ]
    if "out_track" in columns:
        width = interface.track_width
        found.append(
            _unequal("out_track", _values(columns["out_track"], width, None), steps.tracks, steps.tracks)
        )
    for port in interface.outputs:
        seen = _values(columns[port.name], port.width, port.form)
        found.append(_difference(port.signal, seen, outputs[port.signal].ravel(), steps))
    real = [each for each in found if each is not None]
    return min(real, key=lambda each: each.step) if real else None


def _in_states(
    watch: Watch, interface: Interface, section: Section, records: Words, states: dict[str, Integers]
) -> Mismatch | None:
    columns = _columns(records, watch.wires)
    steps = section.steps
    fewest = len(steps.order) - section.left
    if not fewest <= len(records) <= len(steps.order):
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
            seen = _values(columns[state.track], interface.track_width, None)
            found.append(_unequal(state.track, seen, steps.tracks, steps.tracks))
    real = [each for each in found if each is not None]
    return min(real, key=lambda each: each.step) if real else None


def _difference(signal: str, seen: Integers, expected: Integers, steps: Steps) -> Mismatch | None:
    wanted = expected[steps.order]
    return _unequal(signal, seen, wanted.astype(np.int64) if wanted.dtype == bool else wanted, steps.tracks)


def _unequal(signal: str, seen: Integers, wanted: Integers, tracks: Integers) -> Mismatch | None:
    """The first difference; of steps whose results were dropped there is nothing to see."""
    unequal = np.flatnonzero(seen != wanted[: len(seen)])
    if not len(unequal):
        return None
    at = int(unequal[0])
    return Mismatch(
        step=at, track=int(tracks[at]), signal=signal, verilog=int(seen[at]), engine=int(wanted[at])
    )
