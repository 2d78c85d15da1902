"""Verilator: the Verilog that the user gets, as a shared library with the harness of CXXRTL."""

import re
from importlib.resources import files
from pathlib import Path

from kalmanhdl.toolchain import cache
from kalmanhdl.toolchain.compiler import compile_library, find_compiler
from kalmanhdl.toolchain.harness import Border, pairs_header, watches_header
from kalmanhdl.toolchain.installed import installed, version_line
from kalmanhdl.toolchain.process import Tool, run, working_folder

_REMEDY = "install Verilator 5 (Debian: apt-get install verilator), or choose another simulator"
_FLAGS = (
    "--cc",
    "design.v",
    "watches.vlt",
    "--prefix",
    "Vdesign",
    "--Mdir",
    ".",
    "--flatten",
    "-Wno-fatal",
    "-Wno-lint",
)
_OPTIONS = ("-std=c++17", "-shared", "-fPIC", "-fvisibility=hidden", "-w", "-DVL_USER_FATAL", "-I.")
_FAST, _QUICKLY_MADE = "-O2", "-O0"
_RUNTIME = ("verilated.cpp", "verilated_threads.cpp")


def verilator() -> Tool:
    """Verilator as the system has it. Raises ToolError where there is none."""
    return installed("verilator", _REMEDY)


def build_library(verilog: str, top: str, border: Border, *, optimised: bool = True) -> Path:
    """Compile a Verilog design with streams into a shared library; cached by content.

    Raises ToolError where a tool is missing or fails.
    """
    tool, compiler = verilator(), find_compiler()
    options = (*_OPTIONS, _FAST if optimised else _QUICKLY_MADE)
    texts = {
        "design.v": verilog,
        "watches.vlt": _watches(border),
        "model.h": model_header(),
        "top.h": top_header("Vdesign", "Vdesign___024root"),
        "pairs.h": ports_header(border) + watches_header(border, lambda name: _wire(top, name)),
        "harness.cc": _beside("stream_harness.cc"),
    }
    how = (version_line(tool, "--version"), *compiler.command, *_FLAGS, *options, top)

    def make(folder: Path) -> None:
        with working_folder() as work:
            for name, text in texts.items():
                (work / name).write_text(text)
            run(tool, (*_FLAGS, "--top-module", top), work)
            root = Path(run(tool, ("--getenv", "VERILATOR_ROOT"), work).output.strip()) / "include"
            sources = sorted(path.name for path in work.glob("Vdesign*.cpp"))
            sources += [str(root / name) for name in _RUNTIME]
            includes = (f"-I{root}", f"-I{root / 'vltstd'}")
            arguments = (*options, *includes, "harness.cc", *sources)
            compile_library(compiler, arguments, work, folder / "simulator.so")

    return cache.entry("verilator", (*how, *texts.values()), make) / "simulator.so"


def model_header() -> str:
    """The C++ of a model behind what drives it: values on ports, and clocks."""
    return _beside("verilator_model.h")


def top_header(model: str, *parts: str) -> str:
    """What ``verilator_model.h`` reads: the class of the model, and its headers."""
    return "".join(f'#include "{name}.h"\n' for name in (model, *parts)) + f"using Top = {model};\n"


def ports_header(border: Border) -> str:
    """The ports of a design for who drives its model in C++."""
    return pairs_header(border, _port)


def _watches(border: Border) -> str:
    """The wires that Verilator must not optimise away, as its configuration."""
    wires = {name for watch in border.watches for name in (watch.enable, *(wire for wire, _ in watch.wires))}
    names = sorted({name.rpartition(".")[2] for name in wires})
    lines = (f'public_flat_rd -module "*" -var "{name}"' for name in names)
    return "\n".join(("`verilator_config", *lines)) + "\n"


def _port(name: str) -> str:
    return f"model.top.{_mangle(name)}"


def _wire(top: str, name: str) -> str:
    """A wire of the top module or of an instance in it."""
    return "model.top.rootp->" + "__DOT__".join(map(_mangle, (top, *name.split("."))))


def _mangle(name: str) -> str:
    """The name that Verilator gives a Verilog name."""
    words = re.sub("__", "___05F", name)
    return re.sub(r"[^A-Za-z0-9_]", lambda match: f"__0{ord(match[0]):02x}", words)


def _beside(name: str) -> str:
    return files(__package__).joinpath(name).read_text()
