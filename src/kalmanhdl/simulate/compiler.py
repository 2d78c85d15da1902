"""The C compiler of the machine: find it, compile a shared library once, keep it.

Libraries are kept in a folder under names that are digests of source, flags, compiler and processor;
environment variable ``KALMANHDL_CACHE`` chooses another folder.
"""

import hashlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from kalmanhdl.environment import cache_folder, compiler_of
from kalmanhdl.errors import ToolError
from kalmanhdl.validation import shown

# Exact whatever the flags: no contraction into fused multiply-add, and signed integers wrap.
_EXACT = ("-std=gnu11", "-fPIC", "-shared", "-fwrapv", "-ffp-contract=off", "-w")
_FAST = ("-O2", "-march=native", "-fopenmp-simd", "-fno-math-errno", "-fno-trapping-math")
# Only gcc knows these. Selects are to stay selects: threaded into jumps, a loop makes no vectors. Long steps
# keep fewer values in memory where instructions are ordered before registers are given out.
_FAST_GCC = ("-fno-thread-jumps", "-fschedule-insns", "-fsched-pressure")
# Made in a tenth of the time: nothing is optimised, and the operations are calls.
_QUICKLY_MADE = ("-O0", "-march=native", "-DINLINE=static __attribute__((unused))")


def find_compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: ``CC``, cc, gcc or clang of the path, ziglang; None without any.

    Raises ToolError where ``CC`` names none.
    """
    if named := compiler_of("CC"):
        return named
    for name in ("cc", "gcc", "clang"):
        if path := shutil.which(name):
            return (path,)
    return (sys.executable, "-m", "ziglang", "cc") if find_spec("ziglang") else None


def shared_library(source: str, command: Sequence[str], *, optimised: bool = True) -> Path:
    """The path of the shared library of a C source, compiled if it is not kept yet.

    Not ``optimised`` it is made much sooner, and runs much slower.

    Raises ToolError, with the compiler's own words, if it does not compile.
    """
    folder = cache_folder("engine")
    compiler = _identity(tuple(command))
    fast = (*_FAST, *(() if "clang" in compiler else _FAST_GCC))
    flags = (*_EXACT, *(fast if optimised else _QUICKLY_MADE))
    identity = "\0".join([source, *command, *flags, compiler])
    path = folder / f"{hashlib.sha256(identity.encode()).hexdigest()[:32]}.so"
    if not path.exists():
        _compile(source, [*command, *flags], path)
    return path


def _title(command: Sequence[str]) -> str:
    """What a message calls the compiler of a command."""
    named = compiler_of("CC")
    if named and tuple(command[: len(named)]) == named:
        return f"C compiler (CC = {shown(shlex.join(named))})"
    return f"C compiler {command[0]}"


@lru_cache
def _identity(command: tuple[str, ...]) -> str:
    """What a compiler says of its version and of the processor that it compiles for."""
    try:
        done = subprocess.run(
            [*command, "-march=native", "-E", "-v", "-x", "c", os.devnull],
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError as error:
        raise ToolError(f"{_title(command)}: {error.strerror}") from error
    return done.stderr


def _compile(source: str, command: Sequence[str], path: Path) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        code, made = Path(folder) / "engine.c", Path(folder) / "engine.so"
        code.write_text(source, encoding="utf-8")
        code_of_exit, complaint = _run([*command, "-o", str(made), str(code)], folder)
        if code_of_exit:
            lines = complaint.strip().splitlines() or [f"exit code {code_of_exit}"]
            line = next((line for line in lines if "error" in line), lines[-1])
            raise ToolError(f"{_title(command)}: {line}")
        if not made.is_file():
            raise ToolError(f"{_title(command)} ended well but wrote no library: name another compiler in CC")
        os.replace(made, path)


def _run(command: Sequence[str], folder: str) -> tuple[int, str]:
    """The exit code and the words of a compiler. Broken off, its children end too, and leave no files."""
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            env={**os.environ, "TMPDIR": folder},
            start_new_session=True,
        )
    except OSError as error:
        raise ToolError(f"{_title(command)}: {error.strerror}") from error
    with process:
        try:
            _, complaint = process.communicate()
        except BaseException:
            # The driver runs compiler proper, assembler and linker in its own process group.
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return process.returncode, complaint
