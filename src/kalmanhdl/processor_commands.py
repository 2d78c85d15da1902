"""The commands of the programmable processor: parse, call, print."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalmanhdl.console import reported
from kalmanhdl.errors import DataError, ProgramError

if TYPE_CHECKING:
    from kalmanhdl.arithmetic.floating import Float
    from kalmanhdl.model.model import Model
    from kalmanhdl.processor.core import Core
    from kalmanhdl.processor.program import Program
    from kalmanhdl.simulate.data import Plots

_MOST = 1_000_000_000
_Program = Annotated[
    Path, typer.Argument(metavar="PROGRAM", help="A source, or an image where the name ends in .hex.")
]
_Width = Annotated[int | None, typer.Option(help="Bits of a number, 8 to 32.  [default: 32]")]
_Fraction = Annotated[int | None, typer.Option(help="Bits of a number behind the point.  [default: 16]")]
_Format = Annotated[
    str | None,
    typer.Option(
        metavar="FORMAT", help="Floating point: half, single, or the bits EXPONENT,MANTISSA such as 8,7."
    ),
]
_Flush = Annotated[
    bool, typer.Option("--flush", help="With --format: numbers below the least normal one are zeros.")
]
_Rounding = Annotated[str, typer.Option(help="floor, half_up, half_even or toward_zero.")]
_Overflow = Annotated[str | None, typer.Option(help="wrap or saturate.  [default: saturate]")]
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
    format: _Format = None,
    force: _Force = False,
) -> None:
    """Assemble a program for the processor: its image, a word in hexadecimal a line."""
    from kalmanhdl.processor.files import read_program
    from kalmanhdl.processor.program import image
    from kalmanhdl.processor.program import listing as listed

    _check_new(out, force=force)
    found = read_program(program, _core(format=format))
    _put(listed(found) if listing else image(found), out, force=force)


@reported
def disasm(program: _Program, out: _Out = None, format: _Format = None, force: _Force = False) -> None:
    """Turn an image back into a source that assembles to the same words."""
    from kalmanhdl.processor.disassembler import disassemble
    from kalmanhdl.processor.program import read_image

    _check_new(out, force=force)
    words = read_image(program.read_text(encoding="utf-8", errors="replace"), str(program)).words
    _put(disassemble(words, _core(format=format)), out, force=force)


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
    format: _Format = None,
    flush: _Flush = False,
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
    asked = {**given, "size": size, "multipliers": multipliers, "format": format, "flush": flush or None}
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
    width: _Width = None,
    fraction: _Fraction = None,
    rounding: _Rounding = "half_even",
    overflow: _Overflow = None,
    size: _Size = 3,
    multipliers: _Multipliers = 0,
    format: _Format = None,
    flush: _Flush = False,
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
    core = _core(width, fraction, rounding, overflow, size, multipliers, format, flush, functions=False)
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
    width: int | None = None,
    fraction: int | None = None,
    rounding: str = "half_even",
    overflow: str | None = None,
    size: int = 3,
    multipliers: int = 0,
    format: str | None = None,
    flush: bool = False,
    *,
    functions: bool = True,
) -> "Core":
    """``functions``: with all of them. ``format``: of floating-point numbers, else they are fixed point."""
    from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
    from kalmanhdl.processor.core import Core
    from kalmanhdl.processor.instructions import FUNCTIONS

    fixed = {"--width": width, "--fraction": fraction, "--overflow": overflow}
    if format is not None and (told := [name for name, value in fixed.items() if value is not None]):
        raise typer.BadParameter("is for fixed point: leave it out, or --format", param_hint=told[0])
    if flush and format is None:
        raise typer.BadParameter("is for floating point: give a --format", param_hint="--flush")
    overflow = "saturate" if overflow is None else overflow
    for name, value, kind in (("--rounding", rounding, Rounding), ("--overflow", overflow, Overflow)):
        if value not in [each.value for each in kind]:
            valid = ", ".join(each.value for each in kind)
            raise typer.BadParameter(f"{value!r}: one of {valid}", param_hint=name)
    if multipliers % size:
        raise typer.BadParameter(f"{multipliers}: a multiple of the size, {size}", param_hint="--multipliers")
    bits, point = 32 if width is None else width, 16 if fraction is None else fraction
    return Core(
        form=Fixed(width=bits, fraction=point) if format is None else _float(format, rounding, flush=flush),
        rounding=Rounding(rounding),
        overflow=Overflow(overflow),
        extended=True,
        size=size,
        units=multipliers // size,
        functions=FUNCTIONS if functions else (),
    )


def _float(format: str, rounding: str, *, flush: bool) -> "Float":
    """The format of a word, or of bits for exponent and mantissa."""
    from kalmanhdl.arithmetic.fixed import Rounding
    from kalmanhdl.arithmetic.floating import Float
    from kalmanhdl.numerics.floating import FORMATS

    exponent, _, mantissa = format.partition(",")
    if format in FORMATS:
        sizes = FORMATS[format]
    elif exponent.isdecimal() and mantissa.isdecimal() and len(format) < 9:
        sizes = int(exponent), int(mantissa)
    else:
        words = ", ".join(word for word in FORMATS if word != "double")
        raise typer.BadParameter(f"{format!r}: one of {words}, or bits such as 8,7", param_hint="--format")
    return Float(*sizes, Rounding(rounding), not flush)


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
