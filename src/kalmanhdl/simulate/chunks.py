"""Long straight-line code in pieces, since a C compiler's time grows faster than its functions.

A piece is a loop over the tracks of a block; what a later piece needs of it waits in arrays.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from kalmanhdl.simulate.expression import Statement

# Statements of a piece. In one piece, 5000 operations took gcc ten times as long to compile.
CHUNK = 600

_NAME = re.compile(r"\bv\d+\b")


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """Consecutive statements. ``loads`` come from earlier chunks, ``stores`` are for later ones.

    ``sinks`` are the lines whose variables this chunk is the last to define.
    """

    statements: tuple[Statement, ...]
    sinks: tuple[str, ...]
    loads: tuple[Statement, ...]
    stores: tuple[Statement, ...]


def split(statements: Sequence[Statement], sinks: Sequence[str]) -> tuple[Chunk, ...]:
    """Cut statements into chunks, and put each sink (a line that uses variables) where it can be."""
    pieces = [statements[k : k + CHUNK] for k in range(0, len(statements), CHUNK)] or [[]]
    home = {s.name: k for k, piece in enumerate(pieces) for s in piece}
    placed: list[list[str]] = [[] for _ in pieces]
    for line in sinks:
        placed[max((home[name] for name in _names([line])), default=0)].append(line)
    used = [
        _names([*(s.expression for s in piece), *lines]) for piece, lines in zip(pieces, placed, strict=True)
    ]
    last = {name: k for k, names in enumerate(used) for name in names}
    return tuple(
        Chunk(
            statements=tuple(piece),
            sinks=tuple(placed[k]),
            loads=tuple(s for s in statements if s.name in used[k] and home[s.name] < k),
            stores=tuple(s for s in piece if last.get(s.name, k) > k),
        )
        for k, piece in enumerate(pieces)
    )


def _names(texts: Iterable[str]) -> set[str]:
    return {name for text in texts for name in _NAME.findall(text)}
