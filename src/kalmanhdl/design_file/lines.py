"""Where a key stands in the text of a TOML file, for messages."""

import re

_HEADER = re.compile(r"\s*\[{1,2}\s*([^\[\]=]+?)\s*\]{1,2}\s*(#.*)?\Z")

# Strings and comments, in which brackets mean nothing.
_ASIDE = re.compile(r"""\"(?:\\.|[^"\\])*+\"|'[^']*+'|#.*""")


def line_of(text: str, table: str, key: str) -> int | None:
    """The number of the line that sets a key of a table, else of the nearest thing around it that exists.

    Knows tables, dotted keys and inline tables that begin on the line. A guess by lines, not by parsing:
    a message may lack its line, but a file is never refused because of it.
    """
    path = [part for part in (*table.split("."), *_parts(key)) if part]
    lines = _flat(text)
    while path:
        for number, full in lines:
            if full == path:
                return number
        path.pop()
    return None


def twice(text: str, last: int) -> tuple[str, int, int] | None:
    """The name of what is set anew by the entry that ends in line ``last``, and the lines of both.

    None where the lines do not tell.
    """
    lines = [(number, path) for number, path in _flat(text) if number <= last]
    for k in range(len(lines) - 1, -1, -1):
        second, path = lines[k]
        if second != lines[-1][0]:
            break
        earlier = [number for number, other in lines[:k] if other == path]
        if earlier:
            return ".".join(path), earlier[0], second
    return None


def _flat(text: str) -> list[tuple[int, list[str]]]:
    """Every line that opens a table or sets a key, with the full path of what it names."""
    found: list[tuple[int, list[str]]] = []
    current: list[str] = []
    depth = 0
    for number, line in enumerate(text.splitlines(), 1):
        if depth > 0:
            # The value of a line above goes on: a row of a matrix is no header.
            depth += _opened(line)
            continue
        header = _HEADER.match(line)
        if header:
            current = _parts(header[1])
            found.append((number, current))
            continue
        name, equals, value = line.partition("=")
        if not equals or len(name) > 200:
            continue
        depth = _opened(value)
        full = [*current, *_parts(name)]
        found.append((number, full))
        # The keys of an inline table stand on its line.
        if value.lstrip().startswith("{"):
            inner = re.findall(r"[{,]\s*([A-Za-z0-9_\-]+)\s*=", value[:10_000])
            found.extend((number, [*full, part]) for part in inner)
    return found


def _opened(text: str) -> int:
    """How many more brackets a piece of a value opens than it closes."""
    bare = _ASIDE.sub("", text)
    return sum(map(bare.count, "[{")) - sum(map(bare.count, "]}"))


def _parts(dotted: str) -> list[str]:
    """``a.b."c.d"`` as its three parts."""
    quoted = re.findall(r"\s*(?:\"([^\"]*)\"|'([^']*)'|([^.\"']+))\s*(?:\.|\Z)", dotted)
    return ["".join(part).strip() for part in quoted]
