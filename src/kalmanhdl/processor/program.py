"""A program: its words, and what its source calls them; the image that the loader is fed."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from kalmanhdl.errors import ProgramError
from kalmanhdl.validation import shown

_WORD = re.compile(r"[0-9A-Fa-f]{8}\Z")
_MOST_LINES = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """The words from address 0 on, and where its source has them.

    ``lines[address]`` is the line of the source, from 1, of a word; ``labels`` and ``matrices`` are the
    addresses of the names in the program and in the data store.
    """

    words: tuple[int, ...]
    lines: tuple[int, ...] = ()
    source: str = ""
    labels: Mapping[str, int] = field(default_factory=dict)
    matrices: Mapping[str, int] = field(default_factory=dict)


def image(program: Program) -> str:
    """The words as text, eight hexadecimal digits a line: what ``$readmemh`` reads too."""
    return "".join(f"{word:08X}\n" for word in program.words)


def read_image(text: str, name: str) -> Program:
    """The program of an image; ``//`` begins a comment.

    Raises ProgramError with the line of anything that is no word.
    """
    words, lines = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.partition("//")[0].strip()
        if not content:
            continue
        if not _WORD.match(content):
            raise ProgramError(
                f"{name}, line {number}: {shown(content)} is no word: write 8 hexadecimal digits a line"
            )
        words.append(int(content, 16))
        lines.append(number)
        if len(words) > _MOST_LINES:
            raise ProgramError(f"{name}, line {number}: more than {_MOST_LINES} words are no program")
    if not words:
        raise ProgramError(f"{name}: the image has no words: write at least one")
    return Program(words=tuple(words), lines=tuple(lines), source=text)


def listing(program: Program) -> str:
    """Addresses, words and source side by side; lines without a word stand alone."""
    at: dict[int, list[int]] = {}
    for address, line in enumerate(program.lines):
        at.setdefault(line, []).append(address)
    rows = []
    for number, text in enumerate(program.source.splitlines(), start=1):
        addresses = at.get(number, [])
        first = addresses[0] if addresses else None
        place = " " * 13 if first is None else f"{first:03X}  {program.words[first]:08X}"
        rows.append(f"{place}  {number:5d}  {text.expandtabs(8)}".rstrip())
    return "\n".join(rows) + "\n"
