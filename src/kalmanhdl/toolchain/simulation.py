"""A compiled design under ctypes: tokens in, tokens out, the loop over clock cycles in C++."""

import ctypes
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.toolchain.cxxrtl import Border

Words = npt.NDArray[np.uint64]
Cycles = npt.NDArray[np.int64]

# Cycles between two looks at Ctrl-C.
_SLICE = 1_000_000
_DONE, _MORE, _STUCK, _UNSETTLED = range(4)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stalls:
    """How often either side pauses: probabilities per clock cycle, drawn from a seed; 0 = never."""

    seed: int = 0
    source: float = 0.0
    sink: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """What came out: ``outputs[token, word]``, and the cycle in which every token went in and came out."""

    outputs: Words
    accepted_at: Cycles
    produced_at: Cycles
    cycles: int
    # The records of every watch of the border, [record, word].
    watched: tuple[Words, ...]


class _Watched(ctypes.Structure):
    """As the harness has it: a buffer of records, and how many are in it."""

    _fields_ = (
        ("records", ctypes.c_void_p),
        ("words", ctypes.c_int64),
        ("room", ctypes.c_int64),
        ("count", ctypes.c_int64),
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
        self, tokens: Words, out_count: int, stalls: Stalls | None = None, patience: int = 10_000
    ) -> Trace:
        """Send ``tokens[n, words]`` and wait for ``out_count`` tokens.

        A watch keeps at most one record a token.
        A port of more than 64 bits takes several words, low word first; every port starts a new word.
        Raises VerificationError where nothing moves for ``patience`` cycles.
        """
        source, sink = self._border.source, self._border.sink
        tokens = np.ascontiguousarray(tokens, dtype=np.uint64)
        assert tokens.shape == (len(tokens), source.words), (tokens.shape, source.words)
        outputs = np.zeros((out_count, sink.words), np.uint64)
        accepted_at, produced_at = np.zeros(len(tokens), np.int64), np.zeros(out_count, np.int64)
        counts = np.zeros(3, np.int64)
        watches = self._border.watches
        records = [np.zeros((len(tokens), watch.words), np.uint64) for watch in watches]
        watched = (_Watched * max(1, len(watches)))(
            *(_Watched(r.ctypes.data, r.shape[1], len(r), 0) for r in records)
        )
        self._stall(stalls or Stalls())
        status = _MORE
        while status == _MORE:
            status = self._library.simulator_run(
                self._instance,
                *(
                    _pointer(tokens),
                    ctypes.c_int64(len(tokens)),
                    _pointer(outputs),
                    ctypes.c_int64(out_count),
                ),
                *(_pointer(accepted_at), _pointer(produced_at), _pointer(counts), watched),
                *(ctypes.c_int64(_SLICE), ctypes.c_int64(patience)),
            )
        _check(status, counts, len(tokens), out_count, patience)
        return Trace(
            outputs=outputs,
            accepted_at=accepted_at,
            produced_at=produced_at,
            cycles=int(counts[2]),
            watched=tuple(r[: w.count] for r, w in zip(records, watched, strict=False)),
        )

    def _stall(self, stalls: Stalls) -> None:
        words = [ctypes.c_uint64(min(int(p * 2.0**64), 2**64 - 1)) for p in (stalls.source, stalls.sink)]
        self._library.simulator_stall(self._instance, ctypes.c_uint64(stalls.seed), *words)


def _check(status: int, counts: Cycles, tokens: int, results: int, patience: int) -> None:
    where = (
        f"cycle {counts[2]}, {counts[0]} of {tokens} tokens accepted and {counts[1]} of {results} produced"
    )
    if status == _STUCK:
        raise VerificationError(
            f"the simulated design is stuck: nothing moved for {patience} cycles ({where})"
        )
    if status == _UNSETTLED:
        raise VerificationError(
            f"the simulated design does not settle: it has a combinational loop ({where})"
        )


def _pointer(array: npt.NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
