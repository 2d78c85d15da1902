"""A design's program in simulators: every clock in CXXRTL, the shipped test bench in the others."""

from collections.abc import Sequence
from pathlib import Path
from typing import assert_never

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.processor.checks import Checked, drawn_rows, verified
from kalmanhdl.processor.compiler.folder import bench_files
from kalmanhdl.processor.fit import Fitted
from kalmanhdl.processor.follow import Rows, rows_of
from kalmanhdl.processor.program import image
from kalmanhdl.simulate.data import Plots
from kalmanhdl.toolchain.icarus import iverilog, vvp
from kalmanhdl.toolchain.process import Tool, run, working_folder
from kalmanhdl.toolchain.simulators import Simulator
from kalmanhdl.toolchain.verilator import verilator

_FLAGS = ("--binary", "--timing", "--top-module", "testbench", "--Mdir", "made", "--flatten", "-Wno-fatal")
_STYLE = ("-Wno-lint", "-Wno-style")
_LINE = "\n"
_SOURCES = ("testbench.v", "core.v")


def checked_in(
    simulators: Sequence[Simulator],
    fit: Fitted,
    verilog: str,
    plots: Plots | None,
    *,
    steps: int,
    seed: int = 1,
) -> tuple[Checked, ...]:
    """So many rows of the plots and of tracks drawn from the model, in each of some simulators.

    In CXXRTL every clock, in the others what the shipped test bench sees. Raises ToolError,
    VerificationError.
    """
    drawn = drawn_rows(fit, steps, seed)
    data = () if plots is None else rows_of(fit.core, fit.given, fit.scaling, plots)
    tracks = [rows for rows in data if rows]
    found: list[Checked] = []
    for simulator in simulators:
        if simulator is Simulator.CXXRTL:
            found += verified(fit, verilog, tracks, drawn, steps)
        else:
            found.append(bench_runs(fit, verilog, (*tracks, *drawn), steps, simulator))
    return tuple(found)


def bench_runs(
    fit: Fitted, verilog: str, tracks: Sequence[Rows], steps: int, simulator: Simulator
) -> Checked:
    """So many rows of tracks through the test bench, which holds every number that comes out against the
    engine.

    Raises VerificationError with what the bench says, ToolError.
    """
    chosen = _first(tracks, steps)
    with working_folder() as work:
        files = bench_files(fit.filter_, fit.core, fit.program, max(chosen, key=len))
        for name, text in {**files, "core.v": verilog, "program.hex": image(fit.program)}.items():
            (work / name).write_text(text, encoding="utf-8")
        bench, arguments = _compiled(simulator, work)
        for rows in chosen:
            files = bench_files(fit.filter_, fit.core, fit.program, rows)
            inputs, outputs = (files[f"{name}.hex"] for name in ("input", "expected"))
            (work / "input.hex").write_text(inputs, encoding="utf-8")
            (work / "expected.hex").write_text(outputs, encoding="utf-8")
            counts = (f"+inputs={inputs.count(_LINE)}", f"+outputs={outputs.count(_LINE)}")
            said = _said(simulator, bench, (*arguments, *counts), work)
            wanted = len(rows) * len(fit.filter_.outputs)
            if f"{wanted} outputs, 0 wrong" not in said:
                raise VerificationError(
                    f"{simulator.value}: the test bench did not see all of {wanted} outputs"
                )
    done = sum(map(len, chosen))
    numbers = done * len(fit.filter_.outputs)
    return Checked(
        simulator=simulator.value, peripherals="test bench", steps=done, outputs=numbers, values=numbers
    )


def _first(tracks: Sequence[Rows], steps: int) -> list[Rows]:
    """The first rows of tracks one after the other, so many in all."""
    found: list[Rows] = []
    for rows in tracks:
        if steps > 0:
            found.append(rows[:steps])
        steps -= len(rows)
    return found


def _said(simulator: Simulator, bench: Tool, arguments: Sequence[str], work: Path) -> str:
    """What a run of the test bench says. Raises VerificationError with what was wrong, ToolError."""
    try:
        return run(bench, arguments, work).output
    except ToolError as error:
        log = (work / f"{bench.name}.log").read_text(encoding="utf-8", errors="replace")
        wrong = next((line for line in log.splitlines() if line.startswith(("output ", "stuck "))), None)
        if wrong is None:
            raise
        raise VerificationError(f"{simulator.value}: {wrong}") from error


def _compiled(simulator: Simulator, work: Path) -> tuple[Tool, tuple[str, ...]]:
    """The test bench in a folder, compiled: what runs it, and with which arguments."""
    match simulator:
        case Simulator.ICARUS:
            run(iverilog(), ("-g2005", "-o", "bench.vvp", *_SOURCES), work)
            return vvp(), ("-n", "bench.vvp")
        case Simulator.VERILATOR:
            run(verilator(), (*_FLAGS, *_STYLE, *_SOURCES), work)
            made = str(work / "made" / "Vtestbench")
            return Tool(name="testbench", command=(made,), remedy="make the core anew"), ()
        case Simulator.CXXRTL:
            raise AssertionError(simulator)
        case _:
            assert_never(simulator)
