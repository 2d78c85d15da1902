"""Faults planted in generated Verilog: one constant, one shift, one operator, or one register changed.

Each kind has variants, and each variant is planted in the control and in the datapath: the seeds take turns,
so that neither the many lines of the datapath nor the long tables crowd out the rest.
"""

import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

_NAME = r"(?:\\\S+ |[A-Za-z_][\w$.]*)"
_DECLARED = re.compile(rf" +(?:input|output|wire|reg) (?:\[(\d+):0\] )?({_NAME})")
_ASSIGNED = re.compile(r"  assign (?P<target>.+?) = (?P<source>.+);$")
_CLOCKED = re.compile(r"    (?P<target>.+?) <= (?P<source>.+);$")
_ENTRY = re.compile(r"    (?P<target>\S+)\[\d+\] = (?P<source>.+);$")
_ENABLED = re.compile(r"    if \((?P<source>.+?) ?\)$")
_ON_EDGE = "  always @(posedge clk)"
_CONSTANT = re.compile(r"(?<![\w$.])(\d+)'h([0-9a-f]+)")
_SELECTED = re.compile(rf"({_NAME})\[(\d+)(?::(\d+))?\]")
_FILLING = re.compile(r"(?<=, )(\d+)'h0+(?= })")
_RESET = re.compile(r"rst \? (\d+)'h([0-9a-f]+) : (.+)")
_CHOICE = re.compile(r"(?<= \? )(.+) : (.+)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A changed Verilog, and what was changed where."""

    kind: str
    line: int
    before: str
    after: str
    verilog: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Statement:
    """One statement: its text from ``begin`` on, and what is computed in it, from ``source`` on."""

    form: str
    module: str
    begin: int
    text: str
    source: int
    target: str
    widths: dict[str, int]


# Attempts of one variant.
_ATTEMPTS = 3

# Where in the Verilog, from and to, and what stands there instead.
_Change = tuple[int, int, str]


def plant(verilog: str, seed: int, attempt: int = 0) -> Fault:
    """One fault: the seed says of which kind, variant and part of the design; each attempt gives another.

    After some attempts the next variant follows, should no fault of one be a fault: where nothing is
    extended, signs do not matter.
    """
    kind = tuple(_KINDS)[seed % len(_KINDS)]
    groups = _groups(verilog, kind)
    name, changes = groups[(seed // len(_KINDS) + attempt // _ATTEMPTS) % len(groups)]
    chooser = random.Random(f"{seed} {attempt}")
    begin, end, after = chooser.choice(chooser.choice(changes))
    return Fault(
        kind=f"{kind}, {name}",
        line=verilog.count("\n", 0, begin) + 1,
        before=verilog[begin:end],
        after=after,
        verilog=verilog[:begin] + after + verilog[end:],
    )


@lru_cache(maxsize=8)
def _groups(verilog: str, kind: str) -> list[tuple[str, list[list[_Change]]]]:
    """For every variant and part that there is, the changes of each of its statements."""
    found: dict[str, list[list[_Change]]] = {}
    for statement in _statements(verilog):
        part = "datapath" if ".datapath" in statement.module else "control"
        for variant, changes in _KINDS[kind].items():
            if here := list(changes(statement)):
                found.setdefault(f"{variant} in {part}", []).append(here)
    return sorted(found.items())


def _statements(verilog: str) -> Iterator[_Statement]:
    for module in re.finditer(r"^module .*?^endmodule", verilog, re.MULTILINE | re.DOTALL):
        text = module[0]
        name = text.split("(", 1)[0].removeprefix("module ").strip()
        widths = {found[2].strip(): int(found[1] or 0) + 1 for found in _DECLARED.finditer(text)}
        begin, before = module.start(), ""
        for line in text.splitlines(keepends=True):
            bare = line.rstrip("\n")
            form, match = _parsed(bare, before, text)
            if match:
                target = match.groupdict().get("target", "")
                yield _Statement(
                    form=form,
                    module=name,
                    begin=begin,
                    text=bare,
                    source=match.start("source"),
                    target=target,
                    widths=widths,
                )
            begin, before = begin + len(line), bare


def _parsed(line: str, before: str, module: str) -> tuple[str, re.Match[str] | None]:
    if match := _ASSIGNED.match(line):
        return "assignment", match
    if before == _ON_EDGE:
        return "register", _CLOCKED.match(line)
    if (match := _ENTRY.match(line)) and f"{match['target']}[" not in module.split("initial begin")[0]:
        # What a memory starts with is no table.
        written = re.search(rf"{re.escape(match['target'])}\[[^\]]+\]+ <= ", module)
        return "entry", None if written else match
    return "enable", _ENABLED.match(line)


def _bits_flipped(statement: _Statement) -> Iterator[_Change]:
    for match in _CONSTANT.finditer(statement.text, statement.source):
        if not statement.text[: match.start()].endswith("rst ? "):
            for bit in range(int(match[1])):
                changed = int(match[2], 16) ^ 1 << bit
                yield _replaced(statement, match, f"{match[1]}'h{changed:x}")


def _table(statement: _Statement) -> Iterator[_Change]:
    if statement.form == "entry":
        yield from _bits_flipped(statement)


def _number(statement: _Statement) -> Iterator[_Change]:
    if statement.form in ("assignment", "register"):
        yield from _bits_flipped(statement)


def _selection(statement: _Statement) -> Iterator[_Change]:
    """Bits selected one higher or lower, within the bits that there are."""
    for match in _SELECTED.finditer(statement.text, statement.source):
        high, low = int(match[2]), int(match[3] or match[2])
        for step in (-1, 1):
            if low + step >= 0 and high + step < statement.widths.get(match[1].strip(), 0):
                bits = f"{high + step}:{low + step}" if match[3] else f"{high + step}"
                yield _replaced(statement, match, f"{match[1]}[{bits}]")


def _distance(statement: _Statement) -> Iterator[_Change]:
    """A number shifted up, by zeros below it, one place more or less."""
    for match in _FILLING.finditer(statement.text, statement.source):
        for width in (int(match[1]) - 1, int(match[1]) + 1):
            yield _replaced(statement, match, f"{width}'h0" if width else "", comma=not width)


def _operator(pairs: dict[str, str]) -> Callable[[_Statement], Iterator[_Change]]:
    pattern = re.compile("|".join(re.escape(f" {one} ") for one in pairs))

    def changes(statement: _Statement) -> Iterator[_Change]:
        if statement.form in ("assignment", "register"):
            # The blank before a unary operator is the one after the equals sign.
            for match in pattern.finditer(statement.text, statement.source - 1):
                yield _replaced(statement, match, f" {pairs[match[0].strip()]} ".replace("  ", " "))

    return changes


def _signedness(statement: _Statement) -> Iterator[_Change]:
    for match in re.finditer(r"\$signed(?=\()", statement.text):
        yield _replaced(statement, match, "$unsigned")


def _swapped(statement: _Statement) -> Iterator[_Change]:
    match = _CHOICE.search(statement.text.removesuffix(";"), statement.source)
    if match and "rst ? " not in statement.text:
        yield _replaced(statement, match, f"{match[2]} : {match[1]}")


def _removed(statement: _Statement) -> Iterator[_Change]:
    if statement.form == "register":
        source = statement.text[statement.source :]
        begin = statement.begin - len(_ON_EDGE) - 1
        end = statement.begin + len(statement.text)
        yield begin, end, f"  always @*\n    {statement.target} = {source}"


def _doubled(statement: _Statement) -> Iterator[_Change]:
    if statement.form == "register" and (width := _width(statement)):
        source = statement.text[statement.source :]
        begin = statement.begin - len(_ON_EDGE) - 1
        end = statement.begin + len(statement.text)
        late = f"  reg [{width - 1}:0] planted;\n{_ON_EDGE}\n    planted <= {source}\n"
        yield begin, end, f"{late}{_ON_EDGE}\n    {statement.target} <= planted;"


def _width(statement: _Statement) -> int:
    selected = _SELECTED.fullmatch(statement.target)
    if selected:
        return int(selected[2]) - int(selected[3] or selected[2]) + 1
    return statement.widths.get(statement.target.strip(), 0)


def _reset_value(statement: _Statement) -> Iterator[_Change]:
    if match := _RESET.search(statement.text):
        for bit in range(int(match[1])):
            yield _replaced(
                statement, match, f"rst ? {match[1]}'h{int(match[2], 16) ^ 1 << bit:x} : {match[3]}"
            )


def _reset_missing(statement: _Statement) -> Iterator[_Change]:
    if match := _RESET.search(statement.text):
        yield _replaced(statement, match, match[3])


def _always_written(statement: _Statement) -> Iterator[_Change]:
    if statement.form == "enable":
        begin = statement.begin + statement.source
        yield begin, statement.begin + len(statement.text) - 1, "1'h1"


def _replaced(statement: _Statement, match: re.Match[str], after: str, *, comma: bool = False) -> _Change:
    begin, end = statement.begin + match.start(), statement.begin + match.end()
    return begin - 2 * comma, end, after


_KINDS: dict[str, dict[str, Callable[[_Statement], Iterator[_Change]]]] = {
    "constant": {"number": _number, "entry of a table": _table},
    "shift": {"selection": _selection, "distance": _distance},
    "operator": {
        "sum": _operator({"+": "-", "-": "+"}),
        "logic": _operator({"&": "|", "|": "&", "^": "|", "~": ""}),
        "comparison": _operator({"==": "!=", "!=": "==", "<": ">=", "!": "|"}),
        "signedness": _signedness,
        "choice": _swapped,
    },
    "register": {
        "removed": _removed,
        "doubled": _doubled,
        "reset value": _reset_value,
        "reset missing": _reset_missing,
        "always written": _always_written,
    },
}
