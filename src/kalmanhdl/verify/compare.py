"""Verilog and engine, bit for bit: every output and every state of every step."""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from kalmanhdl.errors import VerificationError
from kalmanhdl.rtl.interface import COMMAND_WIDTH, Interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.engine import Trace as EngineTrace
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.toolchain.harness import Border, Stream, Watch
from kalmanhdl.toolchain.simulation import Run, Sent, Simulate, Traces
from kalmanhdl.verify.border import RESET, border_of, sent_numbers, state_watches, stream_pair
from kalmanhdl.verify.clocks import Clocks, clocks_of
from kalmanhdl.verify.stimulus import Section, Steps
from kalmanhdl.verify.words import Words, columns, values_of, words_of


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


def verify(
    simulate: Simulate,
    top: str,
    plan: Plan,
    shown: Interface,
    engine: Engine,
    sections: Sequence[Section],
    *,
    stimulus: str,
    image: Sequence[int] = (),
) -> Verification:
    """Run sections of steps through a simulator of the Verilog and the engine and compare every bit.

    Before them the coefficients of ``image`` are written, by address. Where nobody pauses, the clock in
    which each result comes is compared with what the plan says.
    Raises VerificationError at the first difference, or where the Verilog hangs.
    """
    border, clocks = border_of(shown), clocks_of(plan, shown)
    before: dict[str, Integers] | None = None
    since, seconds = 0, 0.0
    traces = simulate.run(border, chain(_loads(border, image), _runs(border, shown, clocks, sections)))
    if image:
        since = [next(traces)[0].cycles for _ in range(2)][-1]
    for number, section in enumerate(sections):
        steps = section.steps
        begin = time.perf_counter()
        last = number + 1 == len(sections)
        trace = _joined(section, [next(traces) for _ in range(1 + section.blocked + (not last))], last=last)
        seconds += time.perf_counter() - begin
        expected = engine.run(steps.inputs, steps.flags, active=steps.active, initial_state=before)
        parts = _Parts.of(shown, section)
        found = _first_mismatch(border, shown, parts, trace, expected) or _first_late(
            shown, clocks, parts, trace, since
        )
        if found is not None:
            raise VerificationError(f"{top}: {found} ({stimulus} stimulus)")
        before = _left_behind(border, shown, section, parts, trace, expected, before)
        since = trace[0].cycles
    width = sum(w for _, w in border.sink.payload) + sum(
        w for state in state_watches(shown, "") for _, w in state.wires
    )
    sent = sum(len(section.steps.order) for section in sections)
    return Verification(
        simulator=simulate.name,
        stimulus=stimulus,
        steps=sent,
        bits=sent * width,
        cycles=since,
        cycles_per_second=since / seconds if seconds else 0.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Parts:
    """A section as each pair of streams and as each lane sees it: their own steps, in sending order."""

    streams: tuple[Section, ...]
    lanes: tuple[Section, ...]

    @classmethod
    def of(cls, shown: Interface, section: Section) -> "_Parts":
        lanes = tuple(_of_lane(section, shown, lane) for lane in range(shown.lanes))
        return cls(streams=lanes if len(shown.streams) == shown.lanes else (section,), lanes=lanes)


def _of_lane(section: Section, shown: Interface, lane: int) -> Section:
    if shown.lanes == 1:
        return section
    own = section.steps.tracks % shown.lanes == lane
    # Of shared streams so many results are on the way in all, of others so many in each.
    shared = len(shown.streams) == 1
    if shared:
        left = int(own[len(own) - section.left :].sum())
    else:
        count = int(own.sum())
        left = section.left if count > section.left else min(count, 1)
    return replace(section, steps=replace(section.steps, order=section.steps.order[own]), left=left)


def _loads(border: Border, image: Sequence[int]) -> Iterator[Run]:
    """A token for each coefficient, which is no step, and a reset."""
    if not image:
        return
    count = len(image)
    yield _alone(
        border,
        coefficient_write=np.ones(count, np.int64),
        coefficient_address=np.arange(count),
        coefficient_data=np.array(image, dtype=object),
    )
    yield _pulse(border)


def _pulse(border: Border) -> Run:
    """A reset of one clock."""
    return _alone(border, **{RESET: np.ones(1, np.int64)})


def _alone(border: Border, **fields: Integers) -> Run:
    """Tokens through the first stream, whose other ports are zero, without results."""
    count = len(next(iter(fields.values())))
    sent = []
    for number, (source, _) in enumerate(border.pairs):
        zeros = np.zeros(0 if number else count, np.int64)
        words = [
            words_of(zeros if number else fields.get(name, zeros), width) for name, width in source.payload
        ]
        sent.append(Sent(tokens=np.concatenate(words, axis=1), results=0))
    return Run(sent=tuple(sent))


def _runs(border: Border, shown: Interface, clocks: Clocks, sections: Sequence[Section]) -> Iterator[Run]:
    """What is simulated: of a blocked section first what the hardware can hold; between sections a reset."""
    for number, section in enumerate(sections):
        parts = _Parts.of(shown, section).streams
        tokens = [
            _packed(source, shown, part.steps) for part, (source, _) in zip(parts, border.pairs, strict=True)
        ]
        if section.blocked:
            full = clocks.held_back
            yield Run(sent=tuple(Sent(tokens=each[:full], results=0) for each in tokens))
            yield Run(sent=tuple(Sent(tokens=each[full:], results=len(each)) for each in tokens))
        else:
            sent = (
                Sent(tokens=each, results=len(each) - part.left)
                for each, part in zip(tokens, parts, strict=True)
            )
            yield Run(sent=tuple(sent), stalls=section.stalls)
        if number + 1 < len(sections):
            yield _pulse(border)


def _joined(section: Section, traces: list[Traces], *, last: bool) -> Traces:
    """The traces of a section, with what is still written in the clock of the reset that ends it."""
    trace = traces[section.blocked]
    if section.blocked:
        trace = tuple(
            replace(second, accepted_at=np.concatenate([first.accepted_at, second.accepted_at]))
            for first, second in zip(*traces[:2], strict=True)
        )
    if last:
        return trace
    after = traces[-1][0]
    watched = tuple(np.concatenate(both) for both in zip(trace[0].watched, after.watched, strict=True))
    return tuple(replace(each, watched=watched, cycles=after.cycles) for each in trace)


def _first_late(shown: Interface, clocks: Clocks, parts: _Parts, traces: Traces, since: int) -> str | None:
    """What comes in another clock than the plan says, of what it does say; clock 0 is ``since``."""
    for part, trace in zip(parts.streams, traces, strict=True):
        accepted, produced = trace.accepted_at - since, trace.produced_at - since
        tracks = part.steps.tracks if len(parts.streams) == 1 else part.steps.tracks // shown.lanes
        if part.calm:
            seen, wanted, what = produced, clocks.handed_over(tracks)[: len(produced)], "has its result"
        elif part.blocked and clocks.never_waits:
            seen = accepted[clocks.held_back :][:1]
            wanted, what = np.array([clocks.accepted_again(int(produced[0]))]), "is taken"
        else:
            continue
        late = np.flatnonzero(seen != wanted)
        if not len(late):
            continue
        at = int(late[0])
        step = at if part.calm else clocks.held_back
        return (
            f"step {step} (track {part.steps.tracks[step]}) {what} in clock {seen[at]} after reset, "
            f"and by the schedule in clock {wanted[at]}"
        )
    return None


def _left_behind(
    border: Border,
    shown: Interface,
    section: Section,
    parts: _Parts,
    traces: Traces,
    expected: EngineTrace,
    before: dict[str, Integers] | None,
) -> dict[str, Integers]:
    """What the tracks' states are after the reset: of steps that were on the way, some states are written."""
    if not section.left:
        return expected.final_state
    written: dict[str, int] = {}
    for watch, records in zip(border.watches, traces[0].watched, strict=True):
        written |= {name: len(records) for name, _ in watch.wires}
    held = {}
    for state in shown.states:
        states = expected.states[state.state]
        held[state.state] = (
            np.zeros(states.shape[1], states.dtype) if before is None else before[state.state].copy()
        )
        for scope, part in zip(shown.scopes, parts.lanes, strict=True):
            places = part.steps.order[: written[scope + state.data]]
            tracks = part.steps.tracks[: len(places)]
            # The last step of each track.
            _, backwards = np.unique(tracks[::-1], return_index=True)
            last = len(places) - 1 - backwards
            held[state.state][tracks[last]] = states.ravel()[places[last]]
    return held


def _packed(source: Stream, interface: Interface, steps: Steps) -> Words:
    """One token a step, in sending order."""
    fields = {**sent_numbers(steps, interface)}
    fields |= {name: np.zeros(len(steps.order), np.int64) for name in (RESET, *dict(interface.loading))}
    words = [words_of(fields[_bare(name, interface)], width) for name, width in source.payload]
    return np.concatenate(words, axis=1)


def _bare(name: str, interface: Interface) -> str:
    """The name of a port without the lane that stands before it."""
    return next((name.removeprefix(p) for p in interface.streams if p and name.startswith(p)), name)


def _first_mismatch(
    border: Border, interface: Interface, parts: _Parts, traces: Traces, expected: EngineTrace
) -> Mismatch | None:
    found = [
        _in_outputs(
            columns(trace.outputs, stream_pair(interface, "")[1].payload), interface, part.steps, expected
        )
        for part, trace in zip(parts.streams, traces, strict=True)
    ]
    # The simulation keeps no more records than it is given steps, of the second part of a blocked section.
    if not parts.lanes[0].blocked:
        looks = state_watches(interface, "")
        for number, records in enumerate(traces[0].watched):
            lane, look = divmod(number, len(looks))
            found.append(_in_states(looks[look], interface, parts.lanes[lane], records, expected.states))
    return _first(found)


def _first(found: Iterable[Mismatch | None]) -> Mismatch | None:
    real = [each for each in found if each is not None]
    return min(real, key=lambda each: each.step) if real else None


def _in_outputs(
    given: dict[str, Words], interface: Interface, steps: Steps, expected: EngineTrace
) -> Mismatch | None:
    commands = values_of(given["out_command"], COMMAND_WIDTH, None)
    found = [_difference("out_command", commands, steps.commands.ravel(), steps)]
    if "out_track" in given:
        seen = values_of(given["out_track"], interface.track_width, None)
        found.append(_unequal("out_track", seen, interface.track_id(steps.tracks), steps.tracks))
    for port in interface.outputs:
        seen = values_of(given[port.name], port.width, port.form)
        found.append(_difference(port.signal, seen, expected.outputs[port.signal].ravel(), steps))
    return _first(found)


def _in_states(
    watch: Watch, interface: Interface, section: Section, records: Words, states: dict[str, Integers]
) -> Mismatch | None:
    given = columns(records, watch.wires)
    steps = section.steps
    fewest = len(steps.order) - section.left
    if not fewest <= len(records) <= len(steps.order):
        return Mismatch(
            step=max(0, min(len(records), len(steps.order) - 1)),
            track=-1,
            signal=f"number of writes under {watch.enable}",
            verilog=len(records),
            engine=len(steps.order),
        )
    found = []
    for state in interface.states:
        if state.data in given:
            width = state.form.width if state.form else 1
            seen = values_of(given[state.data], width, state.form)
            found.append(_difference(f"state {state.state}", seen, states[state.state].ravel(), steps))
        if state.track and state.track in given:
            seen = values_of(given[state.track], interface.track_width - interface.lane_width, None)
            found.append(_unequal(state.track, seen, steps.tracks // interface.lanes, steps.tracks))
    return _first(found)


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
