"""Programs and numbers from files."""

from pathlib import Path

from kalmanhdl.errors import DataError, ProgramError
from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.core import Core, checked
from kalmanhdl.processor.program import Program, read_image
from kalmanhdl.validation import shown

_MOST_BYTES = 1 << 20


def read_program(path: Path, core: Core) -> Program:
    """The program of a source, or of an image where the file ends in ``.hex``.

    Raises ProgramError where the file cannot be read, or is no program for the core.
    """
    text = _text(path)
    if path.suffix.lower() != ".hex":
        return assemble(text, core, str(path))
    program = read_image(text, str(path))
    try:
        checked(program.words, core)
    except ProgramError as error:
        raise ProgramError(f"{path}: {error}") from None
    return program


def read_numbers(path: Path, core: Core) -> tuple[int, ...]:
    """Real numbers, apart by white space or commas, as raw numbers; ``#`` begins a comment.

    Raises DataError with the line of what is no number, or does not fit the core's words.
    """
    found = []
    for number, line in enumerate(_text(path).splitlines(), start=1):
        for word in line.partition("#")[0].replace(",", " ").split():
            found.append(_raw(word, f"{path}, line {number}", core))
    return tuple(found)


def _raw(word: str, place: str, core: Core) -> int:
    try:
        value = float(word)
        low, high = core.numbers.limits
        if not low <= value <= high:
            raise DataError(
                f"{place}: {shown(word)} is outside {core.form}, {low:g} to {high:g}: scale the numbers"
            )
    except ValueError:
        raise DataError(f"{place}: {shown(word)} is no number") from None
    return core.numbers.nearest(value)


def _text(path: Path) -> str:
    if path.stat().st_size > _MOST_BYTES:
        raise ProgramError(
            f"{path}: {path.stat().st_size} bytes: a program or its input has at most {_MOST_BYTES}"
        )
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ProgramError(f"{path}: is no text: {error.reason} at byte {error.start}") from None
