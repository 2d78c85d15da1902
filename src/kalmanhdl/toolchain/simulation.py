"""A compiled design under ctypes: tokens in, tokens out, the loop over clock cycles in C++."""

import ctypes
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np
import numpy.typing as npt

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.toolchain.harness import Border

Words = npt.NDArray[np.uint64]
Cycles = npt.NDArray[np.int64]

# Cycles between two looks at Ctrl-C.
_SLICE = 1_000_000
_DONE, _MORE, _STUCK, _UNSETTLED = range(4)
# Cycles in which nothing moves before a design counts as stuck.
PATIENCE = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Stalls:
    """How often either side pauses: probabilities per clock cycle, drawn from a seed; 0 = never."""

    seed: int = 0
    source: float = 0.0
    sink: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sent:
    """What goes through one pair of streams: ``tokens[n, words]``, and how many results are waited for.

    A port of more than 64 bits takes several words, low word first; every port starts a new word.
    """

    tokens: Words
    results: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What goes through every pair of streams at once, and how they pause."""

    sent: tuple[Sent, ...]
    stalls: Stalls = field(default_factory=Stalls)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """What came out: ``outputs[token, word]``, and the cycle in which every token went in and came out.

    ``cycles`` are those since the simulation began. ``watched`` has the records of every watch of the border,
    [record, word], at most as many a token of all streams as the watch says.
    """

    outputs: Words
    accepted_at: Cycles
    produced_at: Cycles
    cycles: int
    watched: tuple[Words, ...]


Traces = tuple[Trace, ...]


class Simulate(Protocol):
    """A simulator of one design."""

    @property
    def name(self) -> str:
        """What the simulator is called."""

    def run(self, border: Border, runs: Iterable[Run]) -> Iterator[Traces]:
        """The traces of runs in succession, one for each pair of streams.

        Raises VerificationError where the design hangs.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiled:
    """A design in a shared library, which simulates it as fast as runs are asked for."""

    name: str
    library: Path

    def run(self, border: Border, runs: Iterable[Run]) -> Iterator[Traces]:
        """As ``Simulate`` says."""
        with Simulation(self.library, border) as simulation:
            for run in runs:
                yield simulation.run_all(run)


class _Watched(ctypes.Structure):
    """As the harness has it: a buffer of records, and how many are in it."""

    _fields_ = (
        ("records", ctypes.c_void_p),
        ("words", ctypes.c_int64),
        ("room", ctypes.c_int64),
        ("count", ctypes.c_int64),
    )


class _Flow(ctypes.Structure):
    """As the harness has it: what goes through a pair of streams, and how much of it did."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("tokens", "outputs", "accepted_at", "produced_at")),
        *((name, ctypes.c_int64) for name in ("token_count", "result_count", "accepted", "produced")),
    )


class Simulation:
    """One running instance of a compiled design, after its reset. Its state lasts from run to run."""

    def __init__(self, library: Path, border: Border) -> None:
        try:
            self._library = ctypes.CDLL(str(library))
        except OSError as error:
            raise ToolError(f"cannot load the compiled simulator {library}: {error}") from error
        self._library.simulator_create.restype = ctypes.c_void_p
        self._border = border
        self._instance = ctypes.c_void_p(self._library.simulator_create())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the instance's memory back."""
        if self._instance:
            self._library.simulator_destroy(self._instance)
            self._instance = ctypes.c_void_p()

    def run(
        self, tokens: Words, results: int, stalls: Stalls | None = None, patience: int = PATIENCE
    ) -> Trace:
        """Send tokens through the one pair of streams of a design, and wait for results."""
        sent = (Sent(tokens=tokens, results=results),)
        return self.run_all(Run(sent=sent, stalls=stalls or Stalls()), patience)[0]

    def run_all(self, run: Run, patience: int = PATIENCE) -> Traces:
        """Send tokens through every pair of streams, and wait for their results; a trace each.

        Raises VerificationError where nothing moves for ``patience`` cycles.
        """
        buffers = [
            _Buffers(sent, source.words, sink.words)
            for sent, (source, sink) in zip(run.sent, self._border.pairs, strict=True)
        ]
        flows = (_Flow * len(buffers))(*(each.flow() for each in buffers))
        room = sum(len(sent.tokens) for sent in run.sent)
        records = [np.zeros((room * watch.most, watch.words), np.uint64) for watch in self._border.watches]
        watched = (_Watched * max(1, len(records)))(
            *(_Watched(r.ctypes.data, r.shape[1], len(r), 0) for r in records)
        )
        self._stall(run.stalls)
        cycle, status = ctypes.c_int64(0), _MORE
        while status == _MORE:
            status = self._library.simulator_run(
                self._instance,
                *(flows, watched, ctypes.byref(cycle)),
                *(ctypes.c_int64(_SLICE), ctypes.c_int64(patience)),
            )
        _check(status, flows, cycle.value, patience)
        seen = tuple(r[: w.count] for r, w in zip(records, watched, strict=False))
        return tuple(each.trace(cycle.value, seen) for each in buffers)

    def _stall(self, stalls: Stalls) -> None:
        words = [ctypes.c_uint64(min(int(p * 2.0**64), 2**64 - 1)) for p in (stalls.source, stalls.sink)]
        self._library.simulator_stall(self._instance, ctypes.c_uint64(stalls.seed), *words)


class _Buffers:
    """The arrays that the harness reads from and writes to for one pair of streams."""

    def __init__(self, sent: Sent, in_words: int, out_words: int) -> None:
        self._tokens = tokens = np.ascontiguousarray(sent.tokens, dtype=np.uint64)
        assert tokens.shape == (len(tokens), in_words), (tokens.shape, in_words)
        self._outputs = np.zeros((sent.results, out_words), np.uint64)
        self._accepted_at = np.zeros(len(tokens), np.int64)
        self._produced_at = np.zeros(sent.results, np.int64)

    def flow(self) -> _Flow:
        arrays = (self._tokens, self._outputs, self._accepted_at, self._produced_at)
        return _Flow(*(array.ctypes.data for array in arrays), len(self._tokens), len(self._outputs), 0, 0)

    def trace(self, cycles: int, watched: tuple[Words, ...]) -> Trace:
        return Trace(
            outputs=self._outputs,
            accepted_at=self._accepted_at,
            produced_at=self._produced_at,
            cycles=cycles,
            watched=watched,
        )


def _check(status: int, flows: Iterable[_Flow], cycle: int, patience: int) -> None:
    names = ("accepted", "produced", "token_count", "result_count")
    accepted, produced, tokens, results = (sum(getattr(flow, name) for flow in flows) for name in names)
    where = f"cycle {cycle}, {accepted} of {tokens} tokens accepted and {produced} of {results} produced"
    if status == _STUCK:
        raise VerificationError(
            f"the simulated design is stuck: nothing moved for {patience} cycles ({where})"
        )
    if status == _UNSETTLED:
        raise VerificationError(
            f"the simulated design does not settle: it has a combinational loop ({where})"
        )
