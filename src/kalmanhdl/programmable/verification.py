"""Images in one simulated Verilog, one after the other, against the engine: every bit that can be seen."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import VerificationError
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.programmable.control import Layout
from kalmanhdl.programmable.image import Image, StateWrite
from kalmanhdl.programmable.interface import (
    COMMITTED,
    LOADING,
    Port,
    loading_widths,
    ports_in,
    ports_out,
)
from kalmanhdl.shape import Shape
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.engine import Trace as EngineTrace
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.toolchain.harness import Border, Stream, Watch
from kalmanhdl.toolchain.simulation import Run, Sent, Simulate, Stalls, Trace
from kalmanhdl.verify.border import RESET
from kalmanhdl.verify.compare import Verification
from kalmanhdl.verify.stimulus import Section, Steps, from_model, from_plots, random_steps
from kalmanhdl.verify.words import Words, columns, values_of, words_of

# Clocks from a step's beginning to the first of its rows, and how many more than rows pass between two steps.
FIRST_ROW, BETWEEN = 3, 3
# The clock after reset in which the first step begins, and that in which the result of a step without rows
# would be handed over.
_BEGINS = 2
_HANDED_OVER = _BEGINS + FIRST_ROW
# Sections that resets end, their steps, and how often either side pauses.
_SHORT, _SHORT_STEPS, _PAUSES = 12, 20, (0.0, 0.25, 0.6)
_SCOPE = "datapath."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bound:
    """A filter with its image, and data of its own, if any.

    ``configured``: the simulation begins with the image, so that it is not written first.
    """

    name: str
    model: Model
    typed: TypedGraph
    image: Image
    plots: Plots | None = None
    configured: bool = False


def border_of(shape: Shape) -> Border:
    """The streams of a shape's hardware, its loading ports among what is sent, and its states."""
    into = [(port.name, port.width) for port in ports_in(shape)]
    out = tuple((port.name, port.width) for port in ports_out(shape))
    return Border(
        source=Stream(
            valid="in_valid",
            ready="in_ready",
            payload=(*into, *loading_widths(shape), (RESET, 1)),
        ),
        sink=Stream(valid="out_valid", ready="out_ready", payload=out),
        watches=(Watch(enable=COMMITTED, wires=((COMMITTED, 1),)), *_state_watches(shape)),
    )


def _state_watches(shape: Shape) -> Iterator[Watch]:
    # Neither the bit for banks nor the one that tells which.
    place = Layout(shape).address_bits - 2
    for file in _state_files(shape):
        wires = (
            (f"{_SCOPE}state_place_{file}", place),
            (f"{_SCOPE}state_data_{file}", shape.file_width(file)),
        )
        yield Watch(enable=f"{_SCOPE}state_enable_{file}", wires=wires, most=shape.words // 2)


def _state_files(shape: Shape) -> list[str]:
    return [file for file in shape.files if shape.file_width(file) > 1]


def verify_images(
    simulate: Simulate, top: str, bound: Sequence[Bound], steps: int, seed: int = 1
) -> tuple[Verification, ...]:
    """Write each image in turn into one simulation, and compare ``steps`` steps of it with the engine.

    Half of them are of tracks that the model draws, the others random, with pauses and resets. Where nobody
    pauses, so is the clock of each result. Raises VerificationError at the first difference.
    """
    border = border_of(bound[0].image.shape)
    plans = [(each, _sections(each, steps, seed)) for each in bound]
    traces = simulate.run(border, (run for plan in plans for run in _runs(border, *plan)))
    found = []
    for each, sections in plans:
        begin = time.perf_counter()
        # Of an image and the reset behind it; a simulation begins with a reset of its own.
        since = 0 if each.configured else [next(traces)[0].cycles for _ in range(2)][-1]
        comparison = _Comparison(each, border, since)
        first = comparison.since
        for number, section in enumerate(sections):
            trace, after = next(traces)[0], next(traces)[0]
            problem = comparison.problem(section, trace, after)
            if problem:
                raise VerificationError(f"{top}, image of {each.name}, section {number}: {problem}")
        seconds, cycles = time.perf_counter() - begin, comparison.since - first
        found.append(
            Verification(
                simulator=simulate.name,
                stimulus=each.name,
                steps=sum(len(section.steps.order) for section in sections),
                bits=comparison.bits,
                cycles=cycles,
                cycles_per_second=cycles / seconds,
            )
        )
    return tuple(found)


def _sections(bound: Bound, steps: int, seed: int) -> list[Section]:
    half, random = max(1, steps // 2), np.random.default_rng(seed)
    found = [Section(steps=from_model(bound.model, bound.typed, half, 1, seed))]
    if bound.plots is not None:
        found.insert(0, Section(steps=from_plots(bound.model, bound.typed, bound.plots, 1)))
    rest = half
    for _ in range(min(_SHORT, half // (2 * _SHORT_STEPS))):
        count = int(random.integers(2, _SHORT_STEPS))
        source, sink = random.choice(_PAUSES, 2)
        stalls = Stalls(seed=_seed(random), source=float(source), sink=float(sink))
        each = random_steps(bound.typed, count, 1, _seed(random))
        found.append(Section(steps=each, stalls=stalls, left=int(random.integers(0, 2))))
        rest -= count
    pauses = Stalls(), Stalls(seed=seed, source=_PAUSES[1], sink=_PAUSES[1])
    for count, stalls in zip((rest // 2, rest - rest // 2), pauses, strict=True):
        if count:
            each = random_steps(bound.typed, count, 1, _seed(random))
            found.append(Section(steps=each, stalls=stalls))
    return found


def _seed(random: np.random.Generator) -> int:
    return int(random.integers(1 << 32))


def _runs(border: Border, bound: Bound, sections: Sequence[Section]) -> Iterator[Run]:
    if not bound.configured:
        words = np.array(bound.image.words, object)
        written = np.ones(len(words), np.int64), words[:, 0], words[:, 1]
        yield _alone(border, len(words), dict(zip(LOADING, written, strict=True)))
        yield _reset(border)
    for section in sections:
        sent = _sent(bound, section.steps)
        count = len(section.steps.order)
        yield _run(border, count, sent, count - section.left, section.stalls)
        yield _reset(border)


def _reset(border: Border) -> Run:
    return _alone(border, 1, {RESET: np.ones(1, np.int64)})


def _alone(border: Border, count: int, fields: dict[str, Integers]) -> Run:
    return _run(border, count, fields, 0, Stalls())


def _run(border: Border, count: int, fields: dict[str, Integers], results: int, stalls: Stalls) -> Run:
    """Tokens whose fields are 0 where they are not given."""
    none = np.zeros(count, np.int64)
    words = [words_of(fields.get(name, none), width) for name, width in border.source.payload]
    return Run(sent=(Sent(tokens=np.concatenate(words, axis=1), results=results),), stalls=stalls)


def _sent(bound: Bound, steps: Steps) -> dict[str, Integers]:
    given = {**steps.inputs, **steps.offered, "command": steps.commands}
    return {
        port.name: np.asarray(given[port.signal]).ravel()[steps.order]
        for port in ports_in(bound.image.shape)
        if port.signal in given
    }


class _Comparison:
    """An image beside its engine; keeps what the states were when the section before ended."""

    def __init__(self, bound: Bound, border: Border, since: int) -> None:
        self._bound, self._border, self.since = bound, border, since
        self._engine = Engine.of(bound.typed, optimised=False)
        self._shape = bound.image.shape
        self._before: dict[str, Integers] | None = None
        self.bits = 0

    def problem(self, section: Section, trace: Trace, after: Trace) -> str | None:
        """The first difference of a section, whose reset is in the trace after."""
        steps = section.steps
        expected = self._engine.run(
            steps.inputs, steps.flags, active=steps.active, initial_state=self._before
        )
        watched = [np.concatenate(both) for both in zip(trace.watched, after.watched, strict=True)]
        ended, states = len(watched[0]), watched[1:]
        found = (
            self._in_outputs(steps, trace, expected)
            or self._in_states(states, expected, ended)
            or self._late(section, trace)
        )
        if ended:
            self._before = {name: rows[ended - 1] for name, rows in expected.states.items()}
        self.since = after.cycles
        return found

    def _in_outputs(self, steps: Steps, trace: Trace, expected: EngineTrace) -> str | None:
        given = columns(trace.outputs, self._border.sink.payload)
        for port in ports_out(self._shape):
            if port.signal == "command":
                wanted: Integers = steps.commands.ravel()[steps.order]
            elif port.signal in expected.outputs:
                wanted = expected.outputs[port.signal].ravel()
            else:
                continue
            seen = values_of(given[port.name], port.width, _form(port))
            self.bits += port.width * len(seen)
            if (problem := _unequal(port.signal, seen, wanted)) is not None:
                return problem
        return None

    def _in_states(self, watched: Sequence[Words], expected: EngineTrace, ended: int) -> str | None:
        writes: dict[str, list[StateWrite]] = {}
        for write in self._bound.image.state_writes:
            writes.setdefault(write.file, []).append(write)
        for file, records in zip(_state_files(self._shape), watched, strict=True):
            own = writes.get(file, [])
            if len(records) < ended * len(own) or (not own and len(records)):
                return f"{file}: {len(records)} states are written in {ended} steps"
            for number, write in enumerate(own):
                problem = self._in_state(write, records[number :: len(own)], expected)
                if problem is not None:
                    return problem
        return None

    def _in_state(self, write: StateWrite, records: Words, expected: EngineTrace) -> str | None:
        width = self._shape.file_width(write.file)
        places, seen = records[:, 0], values_of(records[:, 1:], width, Fixed(width=width, fraction=0))
        self.bits += width * len(seen)
        if (places != write.address // 2).any():
            return f"{write.file}: another state is written than {write.kept.state}"
        wanted = expected.states[write.kept.state].ravel().astype(np.int64) << write.kept.lift
        return _unequal(f"state {write.kept.state} in {write.file}", seen, wanted)

    def _late(self, section: Section, trace: Trace) -> str | None:
        if not section.calm:
            return None
        rows = len(self._bound.image.rows)
        seen = trace.produced_at - self.since
        wanted = _HANDED_OVER + rows + np.arange(len(seen)) * (rows + BETWEEN)
        return _unequal("the clock of the result", seen, wanted)


def _form(port: Port) -> Fixed | None:
    return Fixed(width=port.width, fraction=0) if port.is_signed else None


def _unequal(what: str, seen: Integers, wanted: Integers) -> str | None:
    unequal = np.flatnonzero(seen != wanted[: len(seen)])
    if not len(unequal):
        return None
    at = int(unequal[0])
    return f"step {at}, {what}: the Verilog gives {int(seen[at])}, the engine {int(wanted[at])}"
