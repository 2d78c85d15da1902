"""The processor's Verilog under CXXRTL, with peripherals that play in C++."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION, Core
from kalmanhdl.processor.instructions import Opcode
from kalmanhdl.processor.verilog import TOP
from kalmanhdl.toolchain.cxxrtl import compile_simulator, mangled

Integers = npt.NDArray[np.int64]

_NAMES = {
    "CLOCK": "clk",
    "RESET": "rst",
    "PROGRAM_WORD": "program_word",
    "PROGRAM_LAST": "program_last",
    "PROGRAM_VALID": "program_valid",
    "PROGRAM_READY": "program_ready",
    "RUNNING": "running",
    "DATA_IN": "data_in",
    "DATA_READY": "DRDY_I",
    "ACKNOWLEDGE": "ACK_I",
    "OUTPUT_READY": "DRDY_O",
    "OUTPUT_TAKEN": "ACK_O",
    "OPCODE": "opcode",
    "ADDRESS": "pc_current",
    "SATURATED": "saturated",
    "STORED": "written_elements",
}
_PATIENCE = 100 * CLOCKS_PER_INSTRUCTION


@dataclass(frozen=True, slots=True, kw_only=True)
class Peripherals:
    """What stands at the handshakes: see ``peripherals.HandshakingSource`` and ``HandshakingSink``.

    Without latencies a bench that knows the program, ``BenchSource`` and ``BenchSink``.
    """

    tokens: Sequence[int] = ()
    latencies: Sequence[int] | None = None
    reactions: Sequence[int] = ()
    sink_latencies: Sequence[int] | None = None
    sink_reactions: Sequence[int] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Records:
    """The clocks in which an instruction takes effect or a result is stored, before their ends.

    Flags: ACK_I, DRDY_O, DRDY_I, ACK_O, saturated, in columns. The instruction at ``address`` takes effect
    where ``issued`` holds. ``values[k, e]`` goes to element e of the matrix ``matrix[k]`` where ``elements[k,
    e]`` holds.
    """

    clock: Integers
    issued: npt.NDArray[np.bool_]
    address: Integers
    flags: npt.NDArray[np.bool_]
    data_out: Integers
    matrix: Integers
    elements: npt.NDArray[np.bool_]
    values: Integers


class RtlSimulation:
    """One running instance of a core's Verilog. Its data store lasts from program to program.

    Not ``optimised`` it is made in a fraction of the time, and runs many times slower.
    """

    def __init__(self, core: Core, verilog: str, *, optimised: bool = True) -> None:
        self._core = core
        library = _library(core, verilog, optimised=optimised)
        try:
            self._library = ctypes.CDLL(str(library))
        except OSError as error:
            raise ToolError(f"cannot load the compiled simulator {library}: {error}") from error
        self._library.simulator_create.restype = ctypes.c_void_p
        self._library.simulator_load.restype = ctypes.c_int64
        self._library.simulator_run.restype = ctypes.c_int64
        self._instance = ctypes.c_void_p(self._library.simulator_create())
        self._kept: list[Integers] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._library.simulator_destroy(self._instance)
        self._instance = ctypes.c_void_p()

    def load(self, words: Sequence[int], peripherals: Peripherals) -> int:
        """A reset and a program; the clocks of the loading. Raises VerificationError where it never ends."""
        latencies, reactions = peripherals.latencies, peripherals.reactions
        sink_latencies, sink_reactions = peripherals.sink_latencies, peripherals.sink_reactions
        if self._core.pipelined:
            # The benches of ``peripherals.bench``.
            if latencies is None:
                latencies = reactions = [0] * len(peripherals.tokens)
            if sink_latencies is None:
                sink_latencies = sink_reactions = [0]
        arrays = [
            np.array(given, np.int64) if given is not None else None
            for given in (peripherals.tokens, latencies, reactions)
        ]
        sinks = [
            np.array(given, np.int64) if given is not None else None
            for given in (sink_latencies, sink_reactions)
        ]
        # The harness reads them while it runs.
        self._kept = [array for array in (*arrays, *sinks) if array is not None]
        program = np.array(words or [0], np.uint32)
        clocks: int = self._library.simulator_load(
            self._instance,
            ctypes.c_void_p(program.ctypes.data),
            ctypes.c_int64(len(program)),
            ctypes.c_int64(2 * self._core.program_words + _PATIENCE),
        )
        if clocks < 0:
            raise VerificationError("the loader never hands off")
        self._library.simulator_attach(
            self._instance,
            *map(_pointer, arrays),
            ctypes.c_int64(len(peripherals.tokens)),
            *map(_pointer, sinks),
            ctypes.c_int64(len(sink_latencies or ())),
        )
        return clocks

    def run(self, instructions: int) -> Records:
        """So many instructions. Raises VerificationError where none ends for long."""
        core = self._core
        # No instruction stores more than one result.
        words = np.zeros((2 * instructions, _record_words(core)), np.uint64)
        count: int = self._library.simulator_run(
            self._instance,
            ctypes.c_void_p(words.ctypes.data),
            ctypes.c_int64(instructions),
            ctypes.c_int64(_PATIENCE),
        )
        words = words[:count]
        flags = words[:, 1]
        bits = np.stack([flags >> np.uint64(32 + k) & np.uint64(1) for k in range(6)], axis=1) == 1
        done = int(bits[:, 5].sum())
        if done < instructions:
            raise VerificationError(f"the processor is stuck: {done} of {instructions} instructions ended")
        after = 3 + _words(core.elements)
        return Records(
            clock=words[:, 0].astype(np.int64),
            issued=bits[:, 5],
            address=(flags & np.uint64(0xFFFF)).astype(np.int64),
            flags=bits[:, :5],
            data_out=_numbers(words[:, 2:3], 1, core.form.width, signed=not core.floating)[:, 0],
            matrix=(flags >> np.uint64(16) & np.uint64(0xFFFF)).astype(np.int64),
            elements=_numbers(words[:, 3:after], core.elements, 1) != 0,
            values=_numbers(words[:, after:], core.elements, core.form.width, signed=not core.floating),
        )


def _words(bits: int) -> int:
    return -(-bits // 64)


def _record_words(core: Core) -> int:
    return 3 + _words(core.elements) + _words(core.elements * core.form.width)


def _numbers(words: npt.NDArray[np.uint64], count: int, width: int, *, signed: bool = True) -> Integers:
    """Numbers of ``width`` bits that stand one above the other in words, low word first."""
    octets = np.ascontiguousarray(words).astype("<u8").view(np.uint8).reshape(len(words), -1)
    bits = np.unpackbits(octets, axis=1, count=count * width, bitorder="little")
    weights = np.int64(1) << np.arange(width, dtype=np.int64)
    if signed:
        weights[-1] *= -1
    return bits.reshape(len(words), count, width).astype(np.int64) @ weights


def _library(core: Core, verilog: str, *, optimised: bool) -> Path:
    own = {"ISSUED": "issued", "MATRIX": "written_matrix"}
    if not core.pipelined:
        own = {"ISSUED": "last_clock", "MATRIX": "argument_3"}
    lines = [f"#define {word} {mangled(name)}" for word, name in {**_NAMES, **own}.items()]
    lines += [f"#define CLOCK_BEFORE prev_{mangled('clk')}", f"#define TOP {mangled(TOP)}"]
    lines += [f"#define WORD_BITS {core.form.width}", f"#define READ_OPCODE {Opcode.READ.value}"]
    lines += [f"#define RECORD_WORDS {_record_words(core)}"]
    gets, word = "", 2
    for name, width in (
        ("data_out", core.form.width),
        ("written_elements", core.elements),
        ("written", core.elements * core.form.width),
    ):
        gets += f" get<{width}>(top.{mangled(name)}, record + {word});"
        word += _words(width)
    lines += [f"#define GET_RECORD(top, record){gets}"]
    harness = files(__package__).joinpath("processor_harness.cc").read_text()
    return compile_simulator(verilog, TOP, "\n".join(lines) + "\n", harness, optimised=optimised)


def _pointer(array: Integers | None) -> ctypes.c_void_p:
    return ctypes.c_void_p(None if array is None else array.ctypes.data)
