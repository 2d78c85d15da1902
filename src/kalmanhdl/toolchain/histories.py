"""Registers of CXXRTL's C++ kept as a history: a register that only delays another is a look into the past.

CXXRTL keeps two copies of every register and moves all of them in every clock cycle. A pipeline is mostly
delays, so most of its time goes there. Here every cycle has a row of registers; a cycle reads its row and
writes the next one. A delay by n cycles needs no code: it reads n rows back.
"""

import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

_DECLARATION = re.compile(r"^\t(?:/\*\w+\*/ )?wire<(\d+)> (\w+);\n", re.MULTILINE)
_ASSIGNMENT = re.compile(
    r"^\tif \(posedge_\w+\) \{\n((?:\t\t//.*\n)*)\t\t(\w+)\.next = (.*);\n\t\}\n", re.MULTILINE
)
_RESET = re.compile(r"^\t(\w+) = wire<(\d+)>\{(.*)\};\n", re.MULTILINE)
_COMMIT = re.compile(r"^\t\tif \((\w+)\.commit\(observer\)\) changed = true;\n", re.MULTILINE)
_NOW = re.compile(r"\b(\w+)\.curr\b")
_NEXT = re.compile(r"\b(\w+)\.next\b")
_EDGE = re.compile(r"^\tbool (posedge_\w+) = this->\1\(\);\n", re.MULTILINE)
_MODULE = re.compile(r"^struct \w+ : public module \{\n", re.MULTILINE)
_COMMITS = "\t\tbool changed = false;\n"


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a register's value stands: in the column of a register, some rows back."""

    column: str
    rows_back: int


def with_histories(code: str, kept: Collection[str]) -> str:
    """The same design, faster; correct where every evaluation is a rising edge of the one clock.

    ``code`` is what ``write_cxxrtl -g0`` makes of one flat module, ``kept`` the C++ names that others read.
    Those, and registers that are not written once in every cycle, stay as they are.
    """
    widths = {name: width for width, name in _DECLARATION.findall(code)}
    values = {name: value for _, name, value in _ASSIGNMENT.findall(code)}
    written = Counter(_NEXT.findall(code))
    once = {name for name in values if written[name] == 1}
    moved = {name: values[name] for name in widths if name in once and name not in kept}
    if not moved:
        return code
    started = {name for name, _, value in _RESET.findall(code) if set(value.split(",")) != {"0u"}}
    places = {name: _place(name, moved, widths, started) for name in moved}
    columns = [name for name, place in places.items() if not place.rows_back]
    depth = max(place.rows_back for place in places.values())

    def assigned(match: re.Match[str]) -> str:
        notes, name, value = match.groups()
        if name not in places:
            return match[0]
        return "" if places[name].rows_back else f"{notes}\tnow[1].{name} = {value};\n"

    def reset(match: re.Match[str]) -> str:
        name, width, value = match.groups()
        if name not in places:
            return match[0]
        return "" if places[name].rows_back else f"\tnow->{name} = value<{width}>{{{value}}};\n"

    def read(match: re.Match[str]) -> str:
        place = places.get(match[1])
        return f"now[{-place.rows_back}].{place.column}" if place else match[0]

    def unless_moved(match: re.Match[str], name: str) -> str:
        return "" if name in places else match[0]

    code = _ASSIGNMENT.sub(assigned, code)
    code = _RESET.sub(reset, code)
    code = _NOW.sub(read, code)
    code = _DECLARATION.sub(lambda match: unless_moved(match, match[2]), code)
    code = _COMMIT.sub(lambda match: unless_moved(match, match[1]), code)
    code = _EDGE.sub(r"\tconstexpr bool \1 = true;\n\tregisters *const now = this->now;\n", code)
    code = code.replace(_COMMITS, _COMMITS + _advance(depth), 1)
    rows = "".join(f"\t\tvalue<{widths[name]}> {name};\n" for name in columns)
    return _MODULE.sub(lambda match: match[0] + _declared(rows, depth), code, count=1)


def _place(name: str, moved: dict[str, str], widths: dict[str, str], started: Collection[str]) -> _Place:
    """Follow a register back over the ones that it delays. Rows before the first are zero."""
    rows_back = 0
    while (
        name not in started
        and (before := _NOW.fullmatch(moved[name]))
        and before[1] in moved
        and widths[before[1]] == widths[name]
        # Registers in a ring delay each other only.
        and rows_back < len(moved)
    ):
        name, rows_back = before[1], rows_back + 1
    return _Place(name, rows_back)


def _rows(depth: int) -> int:
    # The last rows move to the front when the space ends; the longer it is, the more seldom.
    return 3 * depth + 16


def _declared(rows: str, depth: int) -> str:
    return (
        f"\tstruct registers {{\n{rows}\t}};\n"
        f"\tregisters history[{_rows(depth)}] = {{}};\n\tregisters *now = history + {depth};\n"
    )


def _advance(depth: int) -> str:
    return (
        f"\t\tif (++now == history + {_rows(depth) - 1}) {{\n"
        f"\t\t\tstd::copy(now - {depth}, now + 1, history);\n\t\t\tnow = history + {depth};\n\t\t}}\n"
    )
