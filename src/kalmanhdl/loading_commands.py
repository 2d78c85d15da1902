"""The command that turns a model into the image of hardware that takes others: parse, call, print."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kalmanhdl.console import Progress, reported
from kalmanhdl.programmable_commands import image_programmable

if TYPE_CHECKING:
    from kalmanhdl.numerics.image import Word

_MOST = 1_000_000_000


@reported
def image(
    design: Annotated[
        Path,
        typer.Argument(
            metavar="PATH",
            help="A design with loadable coefficients or a writable control store, or a folder of its build.",
        ),
    ],
    model: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The design file of the model to load.  [default: DESIGN]"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A CSV to write.  [default: print it]")
    ] = None,
    verify: Annotated[
        int, typer.Option(min=0, max=_MOST, help="Steps of the Verilog, once loaded, against the engine.")
    ] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
) -> None:
    """Turn a model into the coefficients of a design's hardware, or say why it does not fit.

    Of hardware with a writable control store: turn a design into its image.
    """
    from kalmanhdl.build import read_design
    from kalmanhdl.design import Design
    from kalmanhdl.loading import image_of, verify_image
    from kalmanhdl.output import check_file
    from kalmanhdl.pipeline import compile_design, numbers_of
    from kalmanhdl.tables import verification_table

    if out is not None:
        check_file(out, force=force)
    built = read_design(design) if design.is_dir() else Design.load(design)
    if built.shape is not None:
        with Progress() as progress:
            text, told = image_programmable(design, built, model, verify_steps=verify, progress=progress)
        _put(text, told if out is not None or verify else "", out, force=force)
        return
    given = built if model is None else Design.load(model)
    found = []
    with Progress() as progress:
        progress("tracing the algorithm on both models")
        numbers = numbers_of(built)
        words = image_of(built, given.model, numbers)
        if verify:
            progress(f"verifying {verify} steps, Verilog against engine")
            found = list(verify_image(compile_design(built), given.model, words, verify))
    _put(_csv(words), verification_table(found) if found else "", out, force=force)


def _put(text: str, table: str, out: Path | None, *, force: bool) -> None:
    from kalmanhdl.output import new_file

    if out is None:
        typer.echo(text, nl=False)
    else:
        with new_file(out, force=force) as file:
            file.write_text(text, encoding="utf-8")
    if table:
        typer.echo(table)


def _csv(words: "tuple[Word, ...]") -> str:
    rows = ["address,raw,width,fraction,value,error,name,use"]
    rows += [
        f'{w.address},{w.raw},{w.form.width},{w.form.fraction},{w.value:.9g},{w.error:.3g},{w.name},"{w.use}"'
        for w in words
    ]
    return "\n".join(rows) + "\n"
