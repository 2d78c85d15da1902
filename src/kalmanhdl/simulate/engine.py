"""The bit-exact engine: every raw integer of a filter, step by step, for many tracks at once.

A typed graph is compiled to C (see ``generate_c``); without a C compiler, and for floating-point numbers of
more than 64 bits, an interpreter gives the same integers, slowly, and ``Engine.compiled`` is False.
"""

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.errors import ToolError
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import Interval, TypedGraph
from kalmanhdl.simulate.arrays import (
    Arrays,
    Extremes,
    Named,
    Results,
    allocated,
    checked,
    look_at_wide,
    whole,
)
from kalmanhdl.simulate.compiler import find_compiler, shared_library
from kalmanhdl.simulate.fallback import run_interpreted
from kalmanhdl.simulate.generate_c import generate
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.simulate.program import Program


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """The raw integers of a run, in arrays of NumPy's narrowest integers that hold them all, of 16 bits or
    more, or of Python's beyond 64 bits; flags are bool.

    ``outputs[name]`` and ``states[name]`` have shape (steps, tracks), the states as they are after each
    step (empty if not recorded); ``final_state[name]`` has shape (tracks,). ``saturations[k]`` counts how
    often the rounded value of operation k did not fit its format, for every operation of which that is
    possible; ``violations[k]`` counts only the steps in which it mattered, for the values of the graph's
    ``violations``. ``extremes[k]`` is what operation k really took, of a monitored run: inputs, states,
    outputs, quantised values and quotients; of floating-point numbers there are none. Steps that are not
    active count nowhere.
    """

    outputs: dict[str, Integers]
    states: dict[str, Integers]
    final_state: dict[str, Integers]
    saturations: dict[int, int]
    violations: dict[int, int]
    extremes: dict[int, Interval]

    @property
    def largest(self) -> dict[int, int]:
        """The largest magnitude that each monitored operation took."""
        return {index: max(-e.low, e.high) for index, e in self.extremes.items()}


@dataclass(frozen=True, slots=True)
class Engine:
    """Runs one typed graph. ``compiled`` tells whether as C or in the interpreter."""

    typed: TypedGraph | FloatGraph
    program: Program
    library: Path | None = field(repr=False)

    @staticmethod
    def of(typed: TypedGraph | FloatGraph, *, optimised: bool = True) -> "Engine":
        """The engine of a graph, compiled unless that was done before. Raises ToolError.

        Not ``optimised`` it is made much sooner, for runs of few steps.
        """
        return engines([typed], optimised=optimised)[0]

    @property
    def compiled(self) -> bool:
        """Whether the engine is compiled C; else it is slow, for want of a compiler or of numbers so wide."""
        return self.library is not None

    def run(
        self,
        inputs: Named,
        flags: Named,
        *,
        active: NDArray[np.bool_] | None = None,
        initial_state: Named | None = None,
        monitor: bool = False,
        record_states: bool = True,
    ) -> Trace:
        """Run all steps of all tracks.

        ``inputs[name]`` are raw integers and ``flags[name]`` booleans, of shape (steps, tracks). Where
        ``active`` is False a track has no step: its state is kept, its outputs mean nothing. States
        start at zero or from ``initial_state[name]``, of shape (tracks,). ``monitor`` keeps extremes.

        Raises FormatError for a number outside its format, DataError for arrays that do not match.
        """
        arrays = checked(self.program, inputs, flags, active, initial_state or {})
        results = allocated(self.program, arrays, record_states)
        if self.library is None:
            look_at_wide(self.program, arrays)
            counts, extremes = run_interpreted(self.typed, self.program, arrays, results)
        else:
            counts, extremes = _run_compiled(self.program, self.library, arrays, results, monitor)
        program = self.program
        return Trace(
            outputs={p.name: whole(p, a) for p, a in zip(program.outputs, results.outputs, strict=True)},
            states={p.name: whole(p, a) for p, a in zip(program.states, results.records, strict=False)},
            final_state={p.name: whole(p, a) for p, a in zip(program.states, arrays.state, strict=True)},
            saturations=dict(zip(program.counted, counts, strict=False)),
            violations=dict(zip(program.violations, counts[len(program.counted) :], strict=True)),
            extremes=extremes if monitor else {},
        )


def engines(
    graphs: Sequence[TypedGraph | FloatGraph], minimum_bits: int = 0, *, optimised: bool = True
) -> tuple[Engine, ...]:
    """The engines of many graphs, compiled together, which is quicker than one by one.

    ``minimum_bits`` forces wider integers than needed; results do not change. Raises ToolError.
    """
    source, programs = generate(graphs, minimum_bits)
    command = find_compiler()
    some = any(program.text for program in programs)
    library = shared_library(source, command, optimised=optimised) if command and some else None
    return tuple(
        Engine(graph, program, library if program.text else None)
        for graph, program in zip(graphs, programs, strict=True)
    )


@lru_cache(maxsize=64)
def _loaded(library: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(library))
    except OSError as error:
        raise ToolError(f"compiled engine {library}: {error}: delete the file to compile it anew") from error


def _pointers(addresses: Sequence[int]) -> ctypes.Array[ctypes.c_void_p]:
    return (ctypes.c_void_p * max(len(addresses), 1))(*addresses)


def _all(arrays: Sequence[Integers]) -> ctypes.Array[ctypes.c_void_p]:
    return _pointers([array.ctypes.data for array in arrays])


def _run_compiled(
    program: Program, library: Path, arrays: Arrays, results: Results, monitor: bool
) -> tuple[list[int], dict[int, Interval]]:
    counts = np.zeros(len(program.counted) + len(program.violations), np.int64)
    above = np.zeros(len(program.inputs), np.uint64)
    loaded = _loaded(library)
    extremes = Extremes(program, ctypes.c_int32.in_dll(loaded, "lanes").value) if monitor else None
    function: Callable[..., int] = getattr(loaded, f"{program.name}_run")
    seen = function(
        ctypes.c_int64(arrays.steps),
        ctypes.c_int64(arrays.tracks),
        _all(arrays.inputs),
        bytes(arrays.wide),
        ctypes.c_void_p(above.ctypes.data),
        _all(arrays.flags),
        None if arrays.active is None else ctypes.c_void_p(arrays.active.ctypes.data),
        _all(arrays.state),
        _pointers(results.addresses[: len(results.outputs)]),
        _pointers(results.addresses[len(results.outputs) :]) if results.records else None,
        ctypes.c_void_p(counts.ctypes.data),
        None if extremes is None else _pointers(extremes.addresses),
        ctypes.c_int32(monitor),
    )
    if seen < 0:
        raise MemoryError
    if any(int(bits) & ~(p.high - p.low) for p, bits in zip(program.inputs, above, strict=True)):
        look_at_wide(program, arrays)
    return counts.tolist(), extremes.seen() if extremes and seen else {}
