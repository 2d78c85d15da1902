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

    In CXXRTL every clock, in the others what the shipped test bench sees of the longest track. Raises
    ToolError, VerificationError.
    """
    drawn = drawn_rows(fit, steps, seed)
    data = () if plots is None else rows_of(fit.core, fit.given, fit.scaling, plots)
    tracks = [rows for rows in data if rows]
    found: list[Checked] = []
    for simulator in simulators:
        if simulator is Simulator.CXXRTL:
            found += verified(fit, verilog, tracks, drawn, steps)
        else:
            longest = max(tracks or drawn, key=len)
            found.append(bench_run(fit, verilog, longest[:steps], simulator))
    return tuple(found)


def bench_run(fit: Fitted, verilog: str, rows: Rows, simulator: Simulator) -> Checked:
    """A track through the test bench, which holds every number that comes out against the engine.

    Raises VerificationError with what the bench says, ToolError.
    """
    files = bench_files(fit.filter_, fit.core, fit.program, rows)
    with working_folder() as work:
        for name, text in {**files, "core.v": verilog, "program.hex": image(fit.program)}.items():
            (work / name).write_text(text, encoding="utf-8")
        bench, arguments = _compiled(simulator, work)
        try:
            said = run(bench, arguments, work).output
        except ToolError as error:
            log = (work / f"{bench.name}.log").read_text(encoding="utf-8", errors="replace")
            wrong = next((line for line in log.splitlines() if line.startswith(("output ", "stuck "))), None)
            if wrong is None:
                raise
            raise VerificationError(f"{simulator.value}: {wrong}") from error
    outputs = len(rows) * len(fit.filter_.outputs)
    if f"{outputs} outputs, 0 wrong" not in said:
        raise VerificationError(f"{simulator.value}: the test bench did not see all of {outputs} outputs")
    return Checked(
        simulator=simulator.value, peripherals="test bench", steps=len(rows), outputs=outputs, values=outputs
    )


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
