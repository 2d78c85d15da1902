"""What the commands do with a design whose control store is writable: parse, call, print."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from kalmanhdl.console import Progress
    from kalmanhdl.design import Design
    from kalmanhdl.programmable.build import Programmed
    from kalmanhdl.simulate.data import Plots
    from kalmanhdl.toolchain.simulators import Simulator

_REPORT = "report.json"


def build_programmable(
    design: "Design",
    out: Path,
    *,
    plots: "Plots | None",
    steps: int | None,
    place: bool,
    simulators: "Sequence[Simulator]",
    force: bool,
) -> None:
    """Build a design into a folder, and print what came out."""
    from kalmanhdl.build import prepare
    from kalmanhdl.console import Progress
    from kalmanhdl.design_file import dumps
    from kalmanhdl.output import check_folder, new_folder
    from kalmanhdl.programmable.build import build, contents, figures, implementation_rows, summary
    from kalmanhdl.report.writer import json_text
    from kalmanhdl.tables import aligned, verification_table

    check_folder(out, force=force)
    with Progress() as progress:
        prepare(place=place, progress=progress)
        built = build(design, steps=steps, plots=plots, place=place, simulators=simulators, progress=progress)
    with new_folder(out, force=force) as folder:
        texts = {
            "design.toml": dumps(design),
            **contents(built.hardware),
            _REPORT: json_text(figures(built)),
        }
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
    rows = implementation_rows(built.hardware, built.placed[:1])
    typer.echo(aligned([*summary(built.hardware.image), *rows]))
    if built.verifications:
        typer.echo(verification_table(built.verifications))
    typer.echo(f"report: {out / _REPORT}")


def show_programmable(design: "Design", *, graph: bool, schedule: bool) -> None:
    """Print how much of its hardware a design takes, its graph, or what runs in which row."""
    from kalmanhdl.graph.text import print_graph
    from kalmanhdl.programmable.build import bound, numbers_of, shape_of, summary
    from kalmanhdl.programmable.text import listing
    from kalmanhdl.tables import aligned

    found = numbers_of(design)
    image = bound(design, shape_of(design), found).image
    if graph:
        typer.echo(print_graph(found.typed.graph), nl=False)
    if schedule:
        typer.echo(listing(image.schedule), nl=False)
    if not graph and not schedule:
        typer.echo(aligned(summary(image)))


def verify_programmable(
    path: Path,
    design: "Design",
    *,
    plots: "Plots | None",
    steps: int | None,
    seed: int,
    simulators: "Sequence[Simulator]",
    progress: "Progress",
) -> str:
    """The table of a verification: of a design, or of a build folder's Verilog, whose report is told."""
    from dataclasses import asdict

    from kalmanhdl.output import new_file
    from kalmanhdl.programmable.build import usual_steps, verify
    from kalmanhdl.report.writer import json_text
    from kalmanhdl.tables import verification_table

    hardware = hardware_of(path, design, progress)
    count = usual_steps(hardware, simulators) if steps is None else steps
    found = verify(hardware, count, plots=plots, seed=seed, simulators=simulators, progress=progress)
    if path.is_dir():
        report = json.loads((path / _REPORT).read_text(encoding="utf-8"))
        report["verification"] = [asdict(each) for each in found]
        with new_file(path / _REPORT, force=True) as file:
            file.write_text(json_text(report), encoding="utf-8")
    return verification_table(found)


def implement_programmable(path: Path, design: "Design", progress: "Progress") -> str:
    """The table of placements of a design, or of the Verilog of its build folder."""
    from kalmanhdl.programmable.build import implement, implementation_rows
    from kalmanhdl.tables import aligned

    hardware = hardware_of(path, design, progress)
    return aligned(implementation_rows(hardware, implement(hardware, progress)))


def image_programmable(
    path: Path, built: "Design", model: Path | None, *, verify_steps: int, progress: "Progress"
) -> tuple[str, str]:
    """The image of a design file for hardware as CSV, and what is told: its ports, and a verification if any.

    ``path`` is that of the hardware's own design or build folder, whose image it is without a file.
    """
    from kalmanhdl.design import Design
    from kalmanhdl.errors import DesignError, FormatError, ScheduleError
    from kalmanhdl.programmable.build import bound, shape_of, verify
    from kalmanhdl.programmable.text import image_csv, ports_text
    from kalmanhdl.tables import verification_table

    progress("binding the design to the units")
    try:
        given = bound(built if model is None else Design.load(model), shape_of(built))
    except (DesignError, FormatError, ScheduleError) as error:
        # Not the hardware's file is to blame.
        problem = str(error) if model is None or str(model) in str(error) else f"{model}: {error}"
        raise DesignError(problem) from None
    ports = ports_text(given.typed, given.image.shape)
    if not verify_steps:
        return image_csv(given.image), ports
    hardware = hardware_of(path, built, progress)
    others = () if model is None else (given,)
    found = verify(hardware, verify_steps, others=others, progress=progress)
    return image_csv(given.image), f"{ports}\n{verification_table(found)}"


def hardware_of(path: Path, design: "Design", progress: "Progress") -> "Programmed":
    """The hardware of a design, or of its build folder with the Verilog that stands there."""
    from dataclasses import replace

    from kalmanhdl.build import prepare, verilog_text
    from kalmanhdl.programmable.build import programmed

    prepare(place=False, progress=progress)
    hardware = programmed(design, progress)
    return replace(hardware, verilog=verilog_text(path, design)) if path.is_dir() else hardware
