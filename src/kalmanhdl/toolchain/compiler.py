"""The C++ compiler of the simulators."""

import os
import shlex
import shutil
import sys
from importlib.util import find_spec

from kalmanhdl.errors import ToolError
from kalmanhdl.toolchain.process import Tool

_REMEDY = "install a C++ compiler (g++ or clang++), name one in CXX, or install the package ziglang"


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
