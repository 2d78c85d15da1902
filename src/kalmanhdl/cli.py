"""The command ``kalmanhdl``: parse, call, print."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalmanhdl import __version__
from kalmanhdl.console import Progress, reported
from kalmanhdl.errors import DesignError
from kalmanhdl.validation import InvalidValueError

if TYPE_CHECKING:
    from kalmanhdl.design import Design
    from kalmanhdl.pipeline import Hardware
    from kalmanhdl.schedule.plan import Plan
    from kalmanhdl.simulate.data import Plots

_MOST = 1_000_000_000
_PICTURES = (".png", ".svg")

app = typer.Typer(
    name="kalmanhdl",
    help="A Kalman filter, written once as a model, becomes verified, placed and routed FPGA hardware.",
    no_args_is_help=True,
    # The boxes of rich take longer to import than everything else that --help needs.
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

_Design = Annotated[Path, typer.Argument(metavar="DESIGN", help="A design file (TOML).")]
_Place = Annotated[Path, typer.Argument(metavar="PATH", help="A design file, or a folder that build made.")]
_Data = Annotated[Path | None, typer.Option(metavar="FILE", help="Measurements, CSV or Parquet.")]
_Force = Annotated[bool, typer.Option("--force", help="Replace a folder that kalmanhdl made.")]
_Steps = Annotated[int, typer.Option(min=1, max=_MOST, help="Steps of the Verilog held against the engine.")]
_Seeds = Annotated[
    int | None, typer.Option(min=1, max=64, help="Placements to try.  [default: the design's]")
]
_Grade = Annotated[int | None, typer.Option(help="Speed grade.  [default: the design's]")]
_Constants = Annotated[
    list[str] | None,
    typer.Option(
        "--constant", metavar="NAME=VALUE", help="In place of an entry of [model.constants]; repeatable."
    ),
]


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"kalmanhdl {__version__}")
        raise typer.Exit


@app.callback()
def kalmanhdl(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """A Kalman filter, written once as a model, becomes verified, placed and routed FPGA hardware."""


@app.command()
@reported
def build(
    design: _Design,
    data: _Data = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The folder to make.  [default: build/NAME]")
    ] = None,
    no_place: Annotated[
        bool, typer.Option("--no-place", help="Leave synthesis, place and route out.")
    ] = False,
    no_verify: Annotated[bool, typer.Option("--no-verify", help="Leave verification out.")] = False,
    areas: Annotated[
        bool, typer.Option("--areas", help="Also synthesis figures on the papers' devices; takes minutes.")
    ] = False,
    steps: _Steps = 100_000,
    seeds: _Seeds = None,
    grade: _Grade = None,
    constant: _Constants = None,
    force: _Force = False,
) -> None:
    """Build a design: Verilog, verified against the engine, placed and routed, with a report."""
    from kalmanhdl.build import build as build_all
    from kalmanhdl.output import check_folder
    from kalmanhdl.tables import build_table

    chosen = _retargeted(_load(design, constant), seeds=seeds, grade=grade)
    place = out or Path("build") / chosen.name
    check_folder(place, force=force)
    plots = _read(data, chosen)
    with Progress() as progress:
        record = build_all(
            chosen,
            place,
            plots=plots,
            verify_steps=0 if no_verify else steps,
            place=not no_place,
            families=areas,
            force=force,
            progress=progress,
        )
    typer.echo(build_table(record))
    typer.echo(f"report: {place / 'report.html'}")


@app.command()
@reported
def simulate(
    design: _Design,
    data: Annotated[Path, typer.Option(metavar="FILE", help="Measurements, CSV or Parquet.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="A folder to make, for estimates.csv.")
    ] = None,
    constant: _Constants = None,
    force: _Force = False,
) -> None:
    """Filter data with the float reference and the bit-exact engine, side by side."""
    from kalmanhdl.output import check_folder, new_folder
    from kalmanhdl.pipeline import simulate as run
    from kalmanhdl.report.estimates import estimates_csv
    from kalmanhdl.tables import accuracy_table

    chosen = _load(design, constant)
    if out is not None:
        check_folder(out, force=force)
    plots = _read(data, chosen)
    assert plots is not None
    with Progress() as progress:
        progress(f"filtering {int(plots.active.sum())} rows of {len(plots.tracks)} tracks")
        simulation = run(chosen, plots)
        if out is not None:
            with new_folder(out, force=force) as folder:
                (folder / "estimates.csv").write_text(
                    estimates_csv(chosen.model, simulation), encoding="utf-8"
                )
    typer.echo(accuracy_table(chosen.model, simulation))
    if out is not None:
        typer.echo(f"estimates: {out / 'estimates.csv'}")


@app.command()
@reported
def verify(
    path: _Place,
    steps: _Steps = 100_000,
    seed: Annotated[int, typer.Option(min=0, max=_MOST, help="Of the random steps.")] = 1,
    data: _Data = None,
    constant: _Constants = None,
) -> None:
    """Hold the Verilog against the bit-exact engine: every bit of every output and state.

    Of a build folder, the Verilog that stands there is verified. Ends with exit code 1 at a difference.
    """
    from kalmanhdl.build import verify_long
    from kalmanhdl.tables import verification_table

    with Progress() as progress:
        hardware = _hardware(path, progress, constant, place=False)
        plots = _read(data, hardware.design)
        progress(f"verifying {steps} steps, Verilog against engine")
        with _blaming(path, hardware.design):
            found = verify_long(hardware, steps, plots, seed)
    typer.echo(verification_table(found))


@app.command()
@reported
def implement(
    path: _Place,
    seeds: _Seeds = None,
    grade: _Grade = None,
    device: Annotated[str | None, typer.Option(help="Such as ecp5-25k.  [default: the design's]")] = None,
    constant: _Constants = None,
) -> None:
    """Synthesise, place and route a design, or the Verilog of a build folder."""
    from kalmanhdl.pipeline import implement as run
    from kalmanhdl.tables import implementation_table

    with Progress() as progress:
        hardware = _hardware(path, progress, constant, place=True, seeds=seeds, grade=grade, device=device)
        with _blaming(path, hardware.design):
            implemented = run(hardware, progress)
    typer.echo(implementation_table(hardware.plan, implemented))


@app.command()
@reported
def show(
    design: _Design,
    graph: Annotated[bool, typer.Option("--graph", help="Print the dataflow graph instead.")] = False,
    schedule: Annotated[bool, typer.Option("--schedule", help="Print the schedule's text instead.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the schedule into a file, PNG or SVG.")
    ] = None,
    constant: _Constants = None,
) -> None:
    """Print a design's operations, formats, bounds and schedule, and draw the schedule."""
    from kalmanhdl.build import planned_design
    from kalmanhdl.graph.text import print_graph
    from kalmanhdl.numerics.floating import FloatSpecification, float_numbers
    from kalmanhdl.schedule.text import print_plan
    from kalmanhdl.tables import design_tables, float_tables

    if out is not None and out.suffix.lower() not in _PICTURES:
        raise typer.BadParameter(f"{out}: write a .png or .svg", param_hint="--out")
    chosen = _load(design, constant)
    if isinstance(chosen.numerics, FloatSpecification) and not schedule and out is None:
        found = float_numbers(chosen.model, chosen.algorithm, chosen.numerics)
        typer.echo(print_graph(found.graph) if graph else float_tables(chosen, found), nl=not graph)
        return
    typed, plan = planned_design(chosen)
    if out is not None:
        _draw(chosen, plan, out)
    if graph:
        typer.echo(print_graph(typed.graph), nl=False)
    if schedule:
        typer.echo(print_plan(plan), nl=False)
    if not graph and not schedule:
        typer.echo(design_tables(chosen, typed, plan))
    if out is not None:
        typer.echo(f"schedule: {out}")


def _blaming(path: Path, design: "Design") -> AbstractContextManager[None]:
    from kalmanhdl.build import blamed_on, verilog_path

    return blamed_on(verilog_path(path, design)) if path.is_dir() else nullcontext()


def _draw(design: "Design", plan: "Plan", out: Path) -> None:
    from kalmanhdl.output import new_file
    from kalmanhdl.report.pictures import save_schedule
    from kalmanhdl.schedule.summary import summarise
    from kalmanhdl.target import device

    summary = summarise(plan, device(design.target.device, design.target.grade))
    with new_file(out) as file:
        save_schedule(summary, design.name, file)


def _load(path: Path, constants: list[str] | None) -> "Design":
    from kalmanhdl.design import Design

    return Design.load(path, dict(map(_constant, constants or [])))


def _constant(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise typer.BadParameter(f"{text!r}: write NAME=VALUE, such as T=1.5", param_hint="--constant")
    return name.strip(), value.strip()


def _retargeted(
    design: "Design", *, seeds: int | None = None, grade: int | None = None, device: str | None = None
) -> "Design":
    given = {"seeds": seeds, "grade": grade, "device": device}
    changed = {key: value for key, value in given.items() if value is not None}
    try:
        return replace(design, target=replace(design.target, **changed))  # type: ignore[arg-type]
    except InvalidValueError as error:
        # No line of the file is to blame.
        raise DesignError(f"--{error.key}{error.problem}") from None


def _read(data: Path | None, design: "Design") -> "Plots | None":
    from kalmanhdl.simulate.data import read_plots

    return None if data is None else read_plots(data, design.model)


def _hardware(
    path: Path,
    progress: Progress,
    constants: list[str] | None,
    *,
    place: bool,
    seeds: int | None = None,
    grade: int | None = None,
    device: str | None = None,
) -> "Hardware":
    """Of a design file: compiled; of a build folder: as it stands there. The tools are made ready before."""
    from kalmanhdl.build import prepare, read_build
    from kalmanhdl.pipeline import compile_design

    if path.is_dir():
        if constants:
            raise typer.BadParameter("a build folder has its numbers already", param_hint="--constant")
        prepare(place=place, progress=progress)
        progress(f"reading the build in {path}")
        hardware = read_build(path)
        return replace(hardware, design=_retargeted(hardware.design, seeds=seeds, grade=grade, device=device))
    design = _retargeted(_load(path, constants), seeds=seeds, grade=grade, device=device)
    _ = design.fixed_point
    prepare(place=place, progress=progress)
    return compile_design(design, progress)
