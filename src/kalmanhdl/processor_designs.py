"""The commands on designs with a processor, and on folders that were built of them."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from kalmanhdl.console import Progress
from kalmanhdl.errors import DesignError

if TYPE_CHECKING:
    from kalmanhdl.design import Design
    from kalmanhdl.processor.checks import Checked
    from kalmanhdl.processor.fit import Fitted
    from kalmanhdl.processor.program import Program
    from kalmanhdl.simulate.data import Plots
    from kalmanhdl.toolchain.simulators import Simulator

STEPS = 1000
"""A step of a program is many clocks, each of which the instruction-set simulator lives through."""


def build_processor(
    design: "Design", out: Path, *, plots: "Plots | None", steps: int, place: bool, force: bool
) -> None:
    """Build a design with ``[architecture] kind = "processor"`` into a folder, and print what came out."""
    from kalmanhdl.build import prepare
    from kalmanhdl.design_file import dumps
    from kalmanhdl.output import check_folder, new_folder
    from kalmanhdl.processor.build import build
    from kalmanhdl.processor.fit import fitted
    from kalmanhdl.report.processor_rows import results, summary
    from kalmanhdl.report.writer import write_processor_report
    from kalmanhdl.tables import aligned

    check_folder(out, force=force)
    with Progress() as progress:
        prepare(place=place, progress=progress)
        progress("compiling the filter to a program")
        built = build(fitted(design), plots, steps=steps, place=place, progress=progress)
        progress("writing the report")
        with new_folder(out, force=force) as folder:
            for name, text in {"design.toml": dumps(design), **built.files}.items():
                (folder / name).write_text(text, encoding="utf-8")
            write_processor_report(built, folder)
    typer.echo(aligned([*summary(built.fit, built.step), *results(built)]))
    typer.echo(f"report: {out / 'report.html'}")


def show_processor(design: "Design") -> None:
    """Print the listing of a design's program, and what it takes."""
    from kalmanhdl.processor.fit import fitted
    from kalmanhdl.processor.program import listing
    from kalmanhdl.processor.step import step_of
    from kalmanhdl.report.processor_rows import summary
    from kalmanhdl.tables import aligned

    fit = fitted(design)
    typer.echo(listing(fit.program))
    typer.echo(aligned(summary(fit, step_of(fit))))


def simulate_processor(design: "Design", plots: "Plots", out: Path | None, *, force: bool) -> None:
    """Filter data with the float reference and the program's engine; print how far apart they are."""
    from kalmanhdl.output import new_folder
    from kalmanhdl.processor.fit import fitted
    from kalmanhdl.processor.follow import follow
    from kalmanhdl.report.estimates import estimates_csv
    from kalmanhdl.report.processor_rows import misfits
    from kalmanhdl.tables import errors_table

    with Progress() as progress:
        progress("compiling the filter to a program")
        fit = fitted(design)
        progress(f"filtering {int(plots.active.sum())} rows of {len(plots.tracks)} tracks")
        found = follow(fit.filter_, fit.core, fit.given, design.algorithm, fit.scaling, plots)
        if out is not None:
            with new_folder(out, force=force) as folder:
                text = estimates_csv(fit.given, found)
                (folder / "estimates.csv").write_text(text, encoding="utf-8")
    typer.echo(errors_table(fit.given, found))
    typer.echo(misfits(found.saturations, found.clipped) or "every number fitted the core's format")
    if not found.valid.any():
        points = design.model.initial.points
        typer.echo(f"no track started: a start takes {points} complete rows in succession", err=True)


def verify_processor(
    design: "Design",
    folder: Path | None,
    *,
    plots: "Plots | None",
    steps: int,
    seed: int,
    simulators: "tuple[Simulator, ...]",
) -> None:
    """Hold engine, instruction-set simulator and Verilog against each other; print what was equal.

    Of a build folder the core and the program that stand there; its report.json is told.
    """
    from kalmanhdl.build import prepare
    from kalmanhdl.processor.simulators import checked_in
    from kalmanhdl.report.processor_rows import verification
    from kalmanhdl.tables import aligned

    with Progress() as progress:
        prepare(place=False, progress=progress)
        progress("compiling the filter to a program")
        fit, verilog = _standing(design, folder)
        progress(f"verifying {steps} steps: engine, instruction-set simulator, Verilog")
        found = checked_in(simulators, fit, verilog, plots, steps=steps, seed=seed)
    if folder is not None:
        _tell(folder, found)
    typer.echo(aligned(verification(found)))


def implement_processor(design: "Design", folder: Path | None) -> None:
    """Synthesise, place and route the core of a design, or the one that stands in a build folder."""
    from kalmanhdl.build import prepare
    from kalmanhdl.processor.build import implemented
    from kalmanhdl.processor.step import step_of
    from kalmanhdl.report.processor_rows import implementation, summary
    from kalmanhdl.tables import aligned

    with Progress() as progress:
        prepare(place=True, progress=progress)
        progress("compiling the filter to a program")
        fit, verilog = _standing(design, folder)
        progress("synthesising, placing and routing")
        placed = implemented(fit, verilog)
    step = step_of(fit)
    typer.echo(aligned([*summary(fit, step), *implementation(placed, step)]))


def standing_program(folder: Path) -> "tuple[Fitted, Program]":
    """The fitted design of a build folder, and the program as its source stands there, with its comments."""
    from kalmanhdl.build import read_design
    from kalmanhdl.processor.files import read_program
    from kalmanhdl.processor.fit import fitted

    design = read_design(folder)
    if design.processor is None:
        raise DesignError(f"{folder}: its design has no processor, and so no program to run")
    fit = fitted(design)
    return fit, read_program(folder / "program.asm", fit.core)


def _standing(design: "Design", folder: Path | None) -> "tuple[Fitted, str]":
    """The program and the Verilog of a design: made of it, or as they stand in a build folder."""
    from kalmanhdl.processor.files import read_program
    from kalmanhdl.processor.fit import fitted
    from kalmanhdl.processor.verilog import core_verilog

    fit = fitted(design)
    if folder is None:
        return fit, core_verilog(fit.core)
    path = folder / "core.v"
    try:
        verilog = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise DesignError(f"{path}: the Verilog of the build cannot be read: {reason}") from None
    words = read_program(folder / "program.hex", fit.core).words
    return replace(fit, program=replace(fit.program, words=words)), verilog


def _tell(folder: Path, found: "tuple[Checked, ...]") -> None:
    """Put verifications into the report of a folder, in place of earlier ones by the same simulators."""
    from kalmanhdl.output import new_file
    from kalmanhdl.report.writer import json_text

    path = folder / "report.json"
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
        again = {one.simulator for one in found}
        kept = [one for one in report["verification"] if one["simulator"] not in again]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DesignError(f"{path}: the report of the build cannot be read: build it again") from error
    report["verification"] = [*kept, *(asdict(one) | {"mismatches": 0} for one in found)]
    with new_file(path, force=True) as file:
        file.write_text(json_text(report), encoding="utf-8")
