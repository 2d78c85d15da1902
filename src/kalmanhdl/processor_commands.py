"""The commands of the programmable processor: parse, call, print."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalmanhdl.console import reported
from kalmanhdl.errors import DataError, ProgramError

if TYPE_CHECKING:
    from kalmanhdl.model.model import Model
    from kalmanhdl.processor.core import Core
    from kalmanhdl.processor.program import Program
    from kalmanhdl.simulate.data import Plots

_MOST = 1_000_000_000
_Program = Annotated[
    Path, typer.Argument(metavar="PROGRAM", help="A source, or an image where the name ends in .hex.")
]
_Width = Annotated[int, typer.Option(help="Bits of a number, 8 to 32.")]
_Fraction = Annotated[int, typer.Option(help="Bits of a number behind the point.")]
_Rounding = Annotated[str, typer.Option(help="floor, half_up, half_even or toward_zero.")]
_Overflow = Annotated[str, typer.Option(help="wrap or saturate.")]
_Size = Annotated[int, typer.Option(help="Rows and columns of the core's matrices, 2 to 16.")]
_Multipliers = Annotated[
    int, typer.Option(help="A multiple of the size: a pipelined core. 0: eight clocks an instruction.")
]
_Out = Annotated[Path | None, typer.Option(metavar="FILE", help="A file to write.  [default: print it]")]
_Force = Annotated[bool, typer.Option("--force", help="Replace the file.")]


@reported
def asm(
    program: _Program,
    out: _Out = None,
    listing: Annotated[
        bool, typer.Option("--listing", help="Addresses, words and source side by side.")
    ] = False,
    force: _Force = False,
) -> None:
    """Assemble a program for the processor: its image, a word in hexadecimal a line."""
    from kalmanhdl.processor.files import read_program
    from kalmanhdl.processor.program import image
    from kalmanhdl.processor.program import listing as listed

    _check_new(out, force=force)
    found = read_program(program, _core())
    _put(listed(found) if listing else image(found), out, force=force)


@reported
def disasm(program: _Program, out: _Out = None, force: _Force = False) -> None:
    """Turn an image back into a source that assembles to the same words."""
    from kalmanhdl.processor.disassembler import disassemble
    from kalmanhdl.processor.program import read_image

    _check_new(out, force=force)
    words = read_image(program.read_text(encoding="utf-8", errors="replace"), str(program)).words
    _put(disassemble(words, _core()), out, force=force)


@reported
def execute(
    program: Annotated[
        Path,
        typer.Argument(
            metavar="PROGRAM",
            help="A source, an image where the name ends in .hex, or the folder of a build.",
        ),
    ],
    data: Annotated[
        Path | None,
        typer.Option(
            "--input",
            metavar="FILE",
            help="Real numbers that READ gets, in order.  [default: input.txt of a folder]",
        ),
    ] = None,
    width: Annotated[int | None, typer.Option(help="Bits of a number, 8 to 32.  [default: 32]")] = None,
    fraction: Annotated[
        int | None, typer.Option(help="Bits of a number behind the point.  [default: 16]")
    ] = None,
    rounding: Annotated[
        str | None, typer.Option(help="floor, half_up, half_even or toward_zero.  [default: half_even]")
    ] = None,
    overflow: Annotated[str | None, typer.Option(help="wrap or saturate.  [default: saturate]")] = None,
    size: Annotated[
        int | None, typer.Option(help="Rows and columns of the core's matrices, 2 to 16.  [default: 3]")
    ] = None,
    multipliers: Annotated[
        int | None,
        typer.Option(
            help="A multiple of the size: a pipelined core. 0: eight clocks an instruction.  [default: 0]"
        ),
    ] = None,
    trace: Annotated[bool, typer.Option("--trace", help="Print every instruction and what it does.")] = False,
    until: Annotated[
        str | None, typer.Option(metavar="LABEL", help="Stop when this label or address comes up again.")
    ] = None,
    passes: Annotated[int, typer.Option(min=1, max=_MOST, help="Stop when it comes up so often.")] = 1,
    dump: Annotated[bool, typer.Option("--dump", help="Print the data store at the end.")] = False,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare", help="Compute in double precision beside it: print how far every instruction is off."
        ),
    ] = False,
    rows: Annotated[
        bool, typer.Option("--rows", help="With --compare of a folder, every row that is put out as well.")
    ] = False,
    instructions: Annotated[int, typer.Option(min=1, max=_MOST, help="Stop after so many.")] = 100_000,
) -> None:
    """Run a program on the instruction-set simulator, and print the numbers that it puts out.

    Of a folder that build made it is the program on its core; with --compare every row is then held against
    the float reference as well, in the units of the model.
    """
    from kalmanhdl.execution import Execution, printed
    from kalmanhdl.processor.files import read_numbers, read_program
    from kalmanhdl.processor_designs import standing_program

    given = {"width": width, "fraction": fraction, "rounding": rounding, "overflow": overflow}
    asked = {**given, "size": size, "multipliers": multipliers}
    told = {key: value for key, value in asked.items() if value is not None}
    fit = None
    if program.is_dir():
        if told:
            raise typer.BadParameter("a build folder has its core already", param_hint=f"--{min(told)}")
        fit, found = standing_program(program)
        core, data = fit.core, data or program / "input.txt"
    else:
        core = _core(**told)  # type: ignore[arg-type]
        found = read_program(program, core)
    tokens = () if data is None else read_numbers(data, core)
    stops = frozenset() if until is None else frozenset({_address(until, found)})
    execution = Execution(core=core, program=found, tokens=tokens, fit=fit, compares=compare)
    done = execution.run(instructions, stops, passes, typer.echo if trace else None)
    for line in printed(execution, done, outputs=not trace, dump=dump, rows=rows):
        typer.echo(line)
    machine = execution.machine
    flag = ", a result did not fit its format" if machine.saturated else ""
    typer.echo(f"{done.reason}: {done.instructions} instructions, {machine.clock} clocks{flag}", err=True)


@reported
def compile_filter(
    design: Annotated[
        Path, typer.Argument(metavar="DESIGN", help="A design file (TOML) of a linear or nonlinear model.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder to make.")],
    data: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Measurements of one track, for a test bench.")
    ] = None,
    width: _Width = 32,
    fraction: _Fraction = 16,
    rounding: _Rounding = "half_even",
    overflow: _Overflow = "saturate",
    size: _Size = 3,
    multipliers: _Multipliers = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace a folder that kalmanhdl made.")] = False,
) -> None:
    """Compile a design's filter to a program of the matrix processor, with its core and a test bench."""
    from kalmanhdl.design import Design
    from kalmanhdl.model.units import unscaled
    from kalmanhdl.output import check_folder, new_folder
    from kalmanhdl.processor.compiler.constants import numbers_read
    from kalmanhdl.processor.compiler.folder import contents
    from kalmanhdl.processor.compiler.generate import equipped, fitting
    from kalmanhdl.processor.follow import follow, rows_of
    from kalmanhdl.report.processor_document import off_reference

    check_folder(out, force=force)
    core = _core(width, fraction, rounding, overflow, size, multipliers, functions=False)
    chosen = Design.load(design)
    filter_ = fitting(chosen.model, chosen.algorithm, core)
    core, model = equipped(core, filter_), filter_.model
    units = unscaled(model.n, model.m, model.p)
    plots = None if data is None else _alone(data, chosen.model)
    # Says so where a constant does not fit.
    numbers_read(filter_, core)
    rows = None if plots is None else rows_of(core, model, units, plots)[0]
    found = contents(filter_, core, rows)
    with new_folder(out, force=force) as folder:
        for name, text in found.items():
            (folder / name).write_text(text, encoding="utf-8")
    words = found["program.hex"].count("\n")
    typer.echo(f"{chosen.name}: {words} words of program for matrices of {size} by {size} of {core.form}")
    if plots is not None:
        followed = follow(filter_, core, model, chosen.algorithm, units, plots)
        typer.echo(f"estimates at most {off_reference(followed).max():.3g} off double precision")
    typer.echo(f"program: {out / 'program.lst'}")


def _alone(data: Path, model: "Model") -> "Plots":
    """The plots of a file with one track."""
    from kalmanhdl.simulate.data import read_plots

    plots = read_plots(data, model)
    if len(plots.tracks) > 1:
        raise DataError(f"{data}: has {len(plots.tracks)} tracks, and a program filters one: give one alone")
    return plots


def _core(
    width: int = 32,
    fraction: int = 16,
    rounding: str = "half_even",
    overflow: str = "saturate",
    size: int = 3,
    multipliers: int = 0,
    *,
    functions: bool = True,
) -> "Core":
    """``functions``: with all of them."""
    from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
    from kalmanhdl.processor.core import Core
    from kalmanhdl.processor.instructions import FUNCTIONS

    for name, value, kind in (("--rounding", rounding, Rounding), ("--overflow", overflow, Overflow)):
        if value not in [each.value for each in kind]:
            valid = ", ".join(each.value for each in kind)
            raise typer.BadParameter(f"{value!r}: one of {valid}", param_hint=name)
    if multipliers % size:
        raise typer.BadParameter(f"{multipliers}: a multiple of the size, {size}", param_hint="--multipliers")
    return Core(
        form=Fixed(width=width, fraction=fraction),
        rounding=Rounding(rounding),
        overflow=Overflow(overflow),
        extended=True,
        size=size,
        units=multipliers // size,
        functions=FUNCTIONS if functions else (),
    )


def _address(text: str, program: "Program") -> int:
    from kalmanhdl.validation import nearest

    if text in program.labels:
        return program.labels[text]
    if text.isdecimal() and int(text) < len(program.words):
        return int(text)
    raise ProgramError(
        f"--until {text}: the program has no such label or address: {nearest(text, program.labels)}"
    )


def _check_new(out: Path | None, *, force: bool) -> None:
    from kalmanhdl.output import check_file

    if out is not None:
        check_file(out, force=force)


def _put(text: str, out: Path | None, *, force: bool) -> None:
    from kalmanhdl.output import new_file

    if out is None:
        typer.echo(text, nl=False)
        return
    with new_file(out, force=force) as file:
        file.write_text(text, encoding="utf-8")
