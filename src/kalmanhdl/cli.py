"""The command ``kalmanhdl``: parse, call, print."""

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalmanhdl import __version__
from kalmanhdl.console import Progress, reported
from kalmanhdl.errors import DesignError
from kalmanhdl.loading_commands import image
from kalmanhdl.processor_commands import (
    asm,
    compile_filter,
    disasm,
    execute,
)
from kalmanhdl.processor_designs import (
    STEPS,
    build_processor,
    implement_processor,
    show_processor,
    simulate_processor,
    verify_processor,
)
from kalmanhdl.programmable_commands import (
    build_programmable,
    implement_programmable,
    show_programmable,
    verify_programmable,
)
from kalmanhdl.validation import InvalidValueError

if TYPE_CHECKING:
    from kalmanhdl.design import Design
    from kalmanhdl.pipeline import Hardware
    from kalmanhdl.schedule.plan import Plan
    from kalmanhdl.simulate.data import Plots
    from kalmanhdl.toolchain.simulators import Simulator

_MOST = 1_000_000_000
_PICTURES = (".png", ".svg")
_TABLES = (".csv", ".json")
# Doubles compute wider words no better.
_WIDEST = 48

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
_ForceFile = Annotated[bool, typer.Option("--force", help="Replace the files.")]
_Steps = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=_MOST,
        help="Steps of the Verilog held against the engine.  [default: 2 million clocks, to 500000 steps]",
    ),
]
_Seeds = Annotated[
    int | None, typer.Option(min=1, max=64, help="Placements to try.  [default: the design's]")
]
_Rounds = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=16,
        help="Schedule and place anew while clock_mhz is missed, so often at most.  [default: the design's]",
    ),
]
_Grade = Annotated[int | None, typer.Option(help="Speed grade.  [default: the design's]")]
_Picture = Annotated[Path | None, typer.Option(metavar="FILE", help="Draw it into a file, PNG or SVG.")]
_Simulator = Annotated[str, typer.Option(help="cxxrtl, verilator, icarus or all.")]
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
    prove: Annotated[
        bool, typer.Option("--prove", help="Also prove which values never leave their formats.")
    ] = False,
    steps: _Steps = None,
    seeds: _Seeds = None,
    rounds: _Rounds = None,
    grade: _Grade = None,
    simulator: _Simulator = "cxxrtl",
    constant: _Constants = None,
    force: _Force = False,
) -> None:
    """Build a design: Verilog, verified against the engine, placed and routed, with a report."""
    from kalmanhdl.build import build as build_all
    from kalmanhdl.output import check_folder
    from kalmanhdl.tables import build_table

    chosen = _retargeted(_load(design, constant), {"seeds": seeds, "rounds": rounds, "grade": grade})
    simulators = _simulators(simulator)
    place = out or Path("build") / chosen.name
    check_folder(place, force=force)
    plots = _read(data, chosen)
    if chosen.processor is not None:
        rows = 0 if no_verify else steps or STEPS
        build_processor(chosen, place, plots=plots, steps=rows, place=not no_place, force=force)
        return
    if chosen.shape is not None:
        build_programmable(
            chosen,
            place,
            plots=plots,
            steps=0 if no_verify else steps,
            place=not no_place,
            simulators=simulators,
            force=force,
        )
        return
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
            simulators=simulators,
            prove=prove,
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
    if chosen.processor is not None:
        simulate_processor(chosen, plots, out, force=force)
        if out is not None:
            typer.echo(f"estimates: {out / 'estimates.csv'}")
        return
    with Progress() as progress:
        progress(f"filtering {int(plots.active.sum())} rows of {len(plots.tracks)} tracks")
        simulation = run(chosen, plots)
        if out is not None:
            with new_folder(out, force=force) as folder:
                (folder / "estimates.csv").write_text(
                    estimates_csv(chosen.model, simulation), encoding="utf-8"
                )
    typer.echo(accuracy_table(chosen.model, simulation))
    if not simulation.valid.any():
        points = chosen.model.initial.points
        typer.echo(f"no track started: a start takes {points} complete rows in succession", err=True)
    if out is not None:
        typer.echo(f"estimates: {out / 'estimates.csv'}")


@app.command()
@reported
def verify(
    path: _Place,
    steps: _Steps = None,
    seed: Annotated[int, typer.Option(min=0, max=_MOST, help="Of the random steps.")] = 1,
    data: _Data = None,
    simulator: _Simulator = "cxxrtl",
    constant: _Constants = None,
) -> None:
    """Hold the Verilog against the bit-exact engine: every bit of every output and state.

    Of a build folder, the Verilog that stands there is verified, and its report.json told. Ends with exit
    code 1 at a difference.
    """
    from kalmanhdl.build import add_to_report, verify_long
    from kalmanhdl.pipeline import usual_steps
    from kalmanhdl.tables import verification_table
    from kalmanhdl.toolchain.simulators import need

    chosen = _simulators(simulator)
    need(chosen)
    design = _design_at(path, constant)
    if design.processor is not None:
        folder = path if path.is_dir() else None
        plots = _read(data, design)
        verify_processor(design, folder, plots=plots, steps=steps or STEPS, seed=seed, simulators=chosen)
        return
    if design.shape is not None:
        with Progress() as progress, _blaming(path, design):
            table = verify_programmable(
                path,
                design,
                plots=_read(data, design),
                steps=steps,
                seed=seed,
                simulators=chosen,
                progress=progress,
            )
        typer.echo(table)
        return
    with Progress() as progress:
        hardware = _hardware(path, progress, constant, place=False)
        plots = _read(data, hardware.design)
        count = usual_steps(hardware, chosen) if steps is None else steps
        progress(f"verifying {count} steps, Verilog against engine")
        with _blaming(path, hardware.design):
            found = verify_long(hardware, count, plots, seed, chosen)
    if path.is_dir():
        add_to_report(path, found)
    typer.echo(verification_table(found))


@app.command()
@reported
def implement(
    path: _Place,
    seeds: _Seeds = None,
    rounds: _Rounds = None,
    grade: _Grade = None,
    device: Annotated[str | None, typer.Option(help="Such as ecp5-25k.  [default: the design's]")] = None,
    constant: _Constants = None,
) -> None:
    """Synthesise, place and route a design, or the Verilog of a build folder."""
    from kalmanhdl.closure.rounds import close
    from kalmanhdl.pipeline import implement as run
    from kalmanhdl.tables import closure_table, implementation_table

    if rounds and path.is_dir():
        problem = "a build folder has its schedule already: give the design file"
        raise typer.BadParameter(problem, param_hint="--rounds")
    changed = {"seeds": seeds, "rounds": rounds, "grade": grade, "device": device}
    design = _retargeted(_design_at(path, constant), changed)
    if design.processor is not None:
        implement_processor(design, path if path.is_dir() else None)
        return
    if design.shape is not None:
        with Progress() as progress, _blaming(path, design):
            table = implement_programmable(path, design, progress)
        typer.echo(table)
        return
    closure = None
    with Progress() as progress:
        hardware = _hardware(path, progress, constant, place=True, target=changed)
        if hardware.design.target.rounds and not path.is_dir():
            closed = close(hardware, progress)
            hardware, implemented, closure = closed.hardware, closed.implemented, closed.closure
        else:
            with _blaming(path, hardware.design):
                implemented = run(hardware, progress)
    architecture = hardware.design.architecture
    typer.echo(implementation_table(hardware.plan, architecture, implemented))
    if architecture.clock_mhz is not None:
        typer.echo(closure_table(architecture, implemented, closure))


@app.command()
@reported
def show(
    design: _Design,
    graph: Annotated[bool, typer.Option("--graph", help="Print the dataflow graph instead.")] = False,
    schedule: Annotated[bool, typer.Option("--schedule", help="Print the schedule's text instead.")] = False,
    prove: Annotated[
        bool, typer.Option("--prove", help="Find out which values can never leave their formats.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the schedule into a file, PNG or SVG.")
    ] = None,
    constant: _Constants = None,
    force: _ForceFile = False,
) -> None:
    """Print a design's operations, formats, bounds and schedule, and draw the schedule."""
    from kalmanhdl.build import planned_design
    from kalmanhdl.graph.text import print_graph
    from kalmanhdl.schedule.text import print_plan
    from kalmanhdl.tables import design_tables

    _check_new(out, "--out", _PICTURES, force=force)
    chosen = _load(design, constant)
    if chosen.processor is not None:
        if out is not None:
            raise typer.BadParameter("a program of the processor has no schedule", param_hint="--out")
        show_processor(chosen)
        return
    if chosen.shape is not None:
        if out is not None:
            raise typer.BadParameter(
                "a step of a programmable datapath is listed, not drawn", param_hint="--out"
            )
        show_programmable(chosen, graph=graph, schedule=schedule)
        return
    with Progress() as progress:
        typed, plan = planned_design(chosen, progress)
    if out is not None:
        _draw(chosen, plan, out, force=force)
    if graph:
        typer.echo(print_graph(typed.graph), nl=False)
    if schedule:
        typer.echo(print_plan(plan), nl=False)
    if not graph and not schedule:
        proof = None
        if prove:
            from kalmanhdl.pipeline import proof_of

            proof = proof_of(chosen, typed)
        typer.echo(design_tables(chosen, typed, plan, proof))
    if out is not None:
        typer.echo(f"schedule: {out}")


@app.command()
@reported
def formats(
    design: _Design,
    data: _Data = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            max=10.0,
            help="By how much of itself the error may grow.  [default: 0.01, or anything with --consistency]",
        ),
    ] = None,
    consistency: Annotated[
        bool, typer.Option("--consistency", help="NEES and NIS are to stay in their bands of 95 %.")
    ] = False,
    objective: Annotated[
        str, typer.Option(help="What is to be small: bits, or area (an estimate).")
    ] = "bits",
    steps: Annotated[
        int | None,
        typer.Option(min=2, max=100_000, help="Of a track.  [default: 200, or 64 without declared ranges]"),
    ] = None,
    tracks: Annotated[int, typer.Option(min=4, max=10_000, help="Tracks drawn from the model.")] = 64,
    seed: Annotated[int, typer.Option(min=0, max=_MOST, help="Of the tracks.")] = 1,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The design file to write.")] = None,
    picture: _Picture = None,
    constant: _Constants = None,
    force: _ForceFile = False,
) -> None:
    """Choose a number format for every signal: the fewest bits, or the least area, within a tolerance."""
    from kalmanhdl.design_file.writer import dumps
    from kalmanhdl.explore.evaluator import Objective
    from kalmanhdl.explore.search import search
    from kalmanhdl.output import new_file
    from kalmanhdl.tables import formats_table

    if objective not in [each.value for each in Objective]:
        raise typer.BadParameter(f"{objective!r}: bits or area", param_hint="--objective")
    _check_new(picture, "--picture", _PICTURES, force=force)
    _check_new(out, "--out", force=force)
    if out is not None and picture is not None and out.absolute() == picture.absolute():
        raise typer.BadParameter(f"{picture}: is --out already: name another file", param_hint="--picture")
    chosen = _load(design, constant)
    plots = _read(data, chosen)
    if tolerance is None and not consistency:
        tolerance = 0.01
    with Progress() as progress:
        found = search(
            chosen,
            tolerance=tolerance,
            consistency=consistency,
            objective=Objective(objective),
            data=plots,
            steps=steps,
            tracks=tracks,
            seed=seed,
            progress=progress,
        )
    typer.echo(formats_table(found, tolerance))
    if out is not None:
        with new_file(out, force=force) as file:
            file.write_text(dumps(replace(chosen, numerics=found.specification)), encoding="utf-8")
        typer.echo(f"design: {out}")
    if picture is not None:
        from kalmanhdl.report.explored import save_front

        with new_file(picture, force=force) as file:
            save_front(found, chosen.name, file)
        typer.echo(f"picture: {picture}")


@app.command()
@reported
def sweep(
    design: _Design,
    widths: Annotated[str, typer.Option(metavar="FROM:TO", help="Word lengths, with both ends.")] = "8:32",
    algorithms: Annotated[
        str, typer.Option(metavar="KIND,...", help="Algorithms to compare.  [default: the design's]")
    ] = "",
    split: Annotated[
        str, typer.Option(help="Binary points by range, or half: in the middle of every word.")
    ] = "range",
    bound: Annotated[float, typer.Option(min=0.0, help="Excess of the error that counts as broken.")] = 1.0,
    steps: Annotated[
        int | None,
        typer.Option(min=2, max=100_000, help="Of a track.  [default: 200, or 64 without declared ranges]"),
    ] = None,
    tracks: Annotated[int, typer.Option(min=1, max=10_000, help="Tracks drawn from the model.")] = 64,
    seed: Annotated[int, typer.Option(min=0, max=_MOST, help="Of the tracks.")] = 1,
    data: _Data = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The rows, CSV or JSON.")] = None,
    picture: _Picture = None,
    constant: _Constants = None,
    force: _ForceFile = False,
) -> None:
    """Accuracy against word length, for one algorithm or several, and where each breaks."""
    from kalmanhdl.explore.sweep import Split
    from kalmanhdl.explore.sweep import sweep as run
    from kalmanhdl.output import new_file
    from kalmanhdl.tables import sweep_table, sweep_text

    if split not in [each.value for each in Split]:
        raise typer.BadParameter(f"{split!r}: range or half", param_hint="--split")
    _check_new(out, "--out", _TABLES, force=force)
    _check_new(picture, "--picture", _PICTURES, force=force)
    lengths = _widths(widths)
    chosen = _load(design, constant)
    kinds = [kind.strip() for kind in algorithms.split(",") if kind.strip()]
    with Progress() as progress:
        rows = run(
            chosen,
            lengths,
            kinds,
            split=Split(split),
            bound=bound,
            data=_read(data, chosen),
            seed=seed,
            steps=steps,
            tracks=tracks,
            progress=progress,
        )
    typer.echo(sweep_table(rows))
    if out is not None:
        with new_file(out, force=force) as file:
            file.write_text(sweep_text(rows, json=out.suffix.lower() == ".json"), encoding="utf-8")
        typer.echo(f"rows: {out}")
    if picture is not None:
        from kalmanhdl.report.explored import save_sweep

        with new_file(picture, force=force) as file:
            save_sweep(rows, chosen.name, file)
        typer.echo(f"picture: {picture}")


@app.command()
@reported
def consistency(
    design: _Design,
    tracks: Annotated[int, typer.Option(min=2, max=1_000_000, help="Tracks drawn from the model.")] = 1000,
    steps: Annotated[int, typer.Option(min=3, max=100_000, help="Measurements of a track.")] = 200,
    seed: Annotated[int, typer.Option(min=0, max=_MOST, help="Of the tracks.")] = 1,
    processes: Annotated[int, typer.Option(min=1, max=256, help="That share the tracks.")] = 2,
    constant: _Constants = None,
) -> None:
    """NEES, NIS and whiteness of float reference and hardware, with bands of 95 %."""
    from kalmanhdl.explore.monte_carlo import monte_carlo
    from kalmanhdl.tables import consistency_table

    chosen = _load(design, constant)
    with Progress() as progress:
        found = monte_carlo(
            chosen, tracks=tracks, steps=steps, seed=seed, processes=processes, progress=progress
        )
    typer.echo(consistency_table(chosen.model, found))


def _check_new(path: Path | None, option: str, suffixes: tuple[str, ...] = (), *, force: bool) -> None:
    """Say before the work what is wrong with a file to be written."""
    from kalmanhdl.output import check_file

    if path is None:
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise typer.BadParameter(f"{path}: write a {' or '.join(suffixes)}", param_hint=option)
    check_file(path, force=force)


def _widths(text: str) -> range:
    first, colon, last = text.partition(":")
    if first.isdecimal() and (last if colon else first).isdecimal():
        found = range(int(first), int(last if colon else first) + 1)
        if found and found[0] >= 2 and found[-1] <= _WIDEST:
            return found
    problem = f"{text!r}: write two word lengths from 2 to {_WIDEST}, such as 8:32"
    raise typer.BadParameter(problem, param_hint="--widths")


@app.command()
@reported
def reproduce(
    paper: Annotated[
        str, typer.Argument(metavar="PAPER", help="bhatia2012, kumar2014, lee1997, liu2007 or wu2012.")
    ],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="A folder to make, for pictures.")] = None,
    no_place: Annotated[
        bool, typer.Option("--no-place", help="Leave the paper's architectures out; they take minutes each.")
    ] = False,
    force: _Force = False,
) -> None:
    """Run a paper's experiment again: its printed figures beside those of the run, then its hardware."""
    from kalmanhdl.output import check_folder, new_folder
    from kalmanhdl.report.chart import save_chart
    from kalmanhdl.reproduce.papers import hardware
    from kalmanhdl.reproduce.papers import reproduce as run
    from kalmanhdl.tables import reproduction_table

    if out is not None:
        check_folder(out, force=force)
    with Progress() as progress:
        found = [run(paper, progress)]
        if not no_place:
            found += hardware(paper, progress)
    tables = "\n\n".join(map(reproduction_table, found))
    typer.echo(tables)
    if out is not None:
        with new_folder(out, force=force) as folder:
            (folder / "figures.txt").write_text(f"{tables}\n", encoding="utf-8")
            for one in found:
                for name, chart in one.charts.items():
                    save_chart(chart, folder / f"{name}.png")
        typer.echo(f"pictures: {out}")


def _simulators(word: str) -> "tuple[Simulator, ...]":
    from kalmanhdl.toolchain.simulators import Simulator

    if word == "all":
        return tuple(Simulator)
    if word not in tuple(Simulator):
        problem = f"{word!r}: {', '.join(Simulator)} or all"
        raise typer.BadParameter(problem, param_hint="--simulator")
    return (Simulator(word),)


app.command()(image)
app.command()(asm)
app.command()(disasm)
app.command("exec")(execute)
app.command("compile")(compile_filter)


def _blaming(path: Path, design: "Design") -> AbstractContextManager[None]:
    from kalmanhdl.build import blamed_on, verilog_path

    return blamed_on(verilog_path(path, design)) if path.is_dir() else nullcontext()


def _draw(design: "Design", plan: "Plan", out: Path, *, force: bool) -> None:
    from kalmanhdl.output import new_file
    from kalmanhdl.report.pictures import save_schedule
    from kalmanhdl.schedule.summary import summarise

    summary = summarise(plan, design.target.part)
    with new_file(out, force=force) as file:
        save_schedule(summary, design.name, file)


def _load(path: Path, constants: list[str] | None) -> "Design":
    from kalmanhdl.design import Design

    return Design.load(path, dict(map(_constant, constants or [])))


def _constant(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise typer.BadParameter(f"{text!r}: write NAME=VALUE, such as T=1.5", param_hint="--constant")
    return name.strip(), value.strip()


def _retargeted(design: "Design", given: Mapping[str, int | str | None]) -> "Design":
    """The design with what options say of its target, by the target's keys; None says nothing."""
    changed = {key: value for key, value in given.items() if value is not None}
    try:
        return replace(design, target=replace(design.target, **changed))  # type: ignore[arg-type]
    except InvalidValueError as error:
        # No line of the file is to blame.
        raise DesignError(f"--{error.key}{error.problem}") from None


def _read(data: Path | None, design: "Design") -> "Plots | None":
    from kalmanhdl.simulate.data import read_plots

    return None if data is None else read_plots(data, design.model)


def _design_at(path: Path, constants: list[str] | None) -> "Design":
    """The design of a file, or of a build folder, whose numbers are its own."""
    from kalmanhdl.build import read_design

    if not path.is_dir():
        return _load(path, constants)
    if constants:
        raise typer.BadParameter("a build folder has its numbers already", param_hint="--constant")
    return read_design(path)


def _hardware(
    path: Path,
    progress: Progress,
    constants: list[str] | None,
    *,
    place: bool,
    target: Mapping[str, int | str | None] | None = None,
) -> "Hardware":
    """Of a design file: compiled; of a build folder: as it stands there. The tools are made ready before."""
    from kalmanhdl.build import prepare, read_build
    from kalmanhdl.pipeline import compile_design

    if path.is_dir():
        prepare(place=place, progress=progress)
        progress(f"reading the build in {path}")
        hardware = read_build(path)
        return replace(hardware, design=_retargeted(hardware.design, target or {}))
    design = _retargeted(_load(path, constants), target or {})
    prepare(place=place, progress=progress)
    return compile_design(design, progress)
