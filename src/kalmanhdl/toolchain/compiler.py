"""The C++ compiler of the simulators."""

import shlex
import shutil
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from kalmanhdl.environment import compiler_of
from kalmanhdl.errors import ToolError
from kalmanhdl.toolchain.process import Tool, run
from kalmanhdl.validation import shown

_REMEDY = "install a C++ compiler (g++ or clang++), name one in CXX, or install the package ziglang"


def find_compiler() -> Tool:
    """The C++ compiler: CXX, else the first of g++, clang++ and c++, else the one of ziglang.

    Raises ToolError where there is none, or CXX names none.
    """
    if named := compiler_of("CXX"):
        title = f"C++ compiler (CXX = {shown(shlex.join(named))})"
        return Tool(name="c++", command=named, remedy=_REMEDY, title=title)
    for name in ("g++", "clang++", "c++"):
        if path := shutil.which(name):
            return Tool(name=name, command=(path,), remedy=_REMEDY)
    if find_spec("ziglang"):
        return Tool(name="zig", command=(sys.executable, "-m", "ziglang", "c++"), remedy=_REMEDY)
    raise ToolError(f"no C++ compiler was found: {_REMEDY}")


def compile_library(compiler: Tool, arguments: Sequence[str], work: Path, library: Path) -> None:
    """Compile what is in a folder into a shared library. Raises ToolError with the compiler's error line."""
    made = work / "simulator.so"
    run(compiler, (*arguments, "-o", made.name), work)
    if not made.is_file():
        raise ToolError(f"{compiler} ended well but wrote no {made.name}: {compiler.remedy}")
    shutil.copyfile(made, library)
