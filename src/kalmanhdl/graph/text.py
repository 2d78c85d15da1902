"""A graph as text, for readers and for golden tests, and back.

    operations
    %0 = input z[0]  # measurement: z[0]
    %1 = state x[0]  # state: x[0]
    %2 = subtract %0 %1  # update: y[0]
    states
    x[0] = %2
    outputs
    innovation[0] = %2

Later stages note what they know of an operation behind a colon, and add sections of their own.
"""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any, get_args

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.errors import DesignError, FormatError
from kalmanhdl.graph.operations import Boolean, Function, Graph, Number, Operation, Product, operands

_FORMAT = r"u?fixed\(\d+, fraction=-?\d+\)"
_NAME = r'[A-Za-z_][^\s"#:=]*|"(?:[^"\\]|\\.)*"'
_CLASSES: dict[str, type[Operation]] = {
    re.sub(r"(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower(): cls
    for cls in (*get_args(Number), *get_args(Boolean))
}
_MNEMONICS = {cls: mnemonic for mnemonic, cls in _CLASSES.items()}


@dataclass(frozen=True, slots=True)
class Section:
    """The lines under one heading, each with its number in the text."""

    lines: tuple[tuple[int, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphText:
    """A parsed text: the graph, the note of every operation, and the sections of later stages."""

    graph: Graph
    notes: tuple[str, ...]
    sections: dict[str, Section]


def print_graph(graph: Graph, notes: Sequence[str] = ()) -> str:
    """The text of a graph, with a note behind each operation that has one."""
    lines = ["operations"]
    for index, (operation, origin) in enumerate(zip(graph.operations, graph.origins, strict=True)):
        note = f" : {notes[index]}" if notes and notes[index] else ""
        comment = f"  # {_origin(origin)}" if origin else ""
        lines.append(f"%{index} = {print_operation(operation)}{note}{comment}")
    for heading, roots in (("states", graph.states), ("outputs", graph.outputs)):
        lines += [heading, *(f"{print_name(name)} = %{root}" for name, root in roots)]
    return "\n".join(lines) + "\n"


def print_operation(operation: Operation) -> str:
    """An operation with what it reads, such as ``add %1 %2``."""
    words = [_FIELDS[f.name].written(getattr(operation, f.name)) for f in fields(operation)]
    return " ".join((_MNEMONICS[type(operation)], *words))


def print_name(name: str) -> str:
    """A name as it is, or in quotes where it would be misread."""
    return name if re.fullmatch(_NAME, name) and not name.startswith('"') else json.dumps(name)


def parse_name(text: str) -> str:
    """The name that ``print_name`` wrote."""
    return str(json.loads(text)) if text.startswith('"') else text


def parse_format(text: str) -> Fixed:
    """The format that ``str`` of a ``Fixed`` wrote."""
    width, fraction = map(int, re.findall(r"-?\d+", text))
    return Fixed(width=width, fraction=fraction, signed=not text.startswith("u"))


def parse_graph(text: str) -> Graph:
    """The graph that ``print_graph`` wrote. Raises DesignError with the line that is not understood."""
    return parse_graph_text(text).graph


def parse_graph_text(text: str) -> GraphText:
    """The graph, the notes and all further sections. Raises DesignError as ``parse_graph`` does."""
    sections = dict(_sections(text))
    operations: list[Operation] = []
    origins: list[str] = []
    notes: list[str] = []
    for number, line in _lines(sections, "operations"):
        operation, note, origin = _parse_line(number, line, len(operations))
        operations.append(operation)
        notes.append(note)
        origins.append(origin)
    roots = {
        heading: tuple(
            _parse_root(number, line, len(operations)) for number, line in _lines(sections, heading)
        )
        for heading in ("states", "outputs")
    }
    graph = Graph(tuple(operations), tuple(origins), roots["states"], roots["outputs"])
    return GraphText(graph=graph, notes=tuple(notes), sections=sections)


def misread(number: int, line: str, remedy: str) -> DesignError:
    """The error of a line that is not understood."""
    return DesignError(f"line {number}: {line.strip()!r} is not understood: write {remedy}")


def _sections(text: str) -> Iterator[tuple[str, Section]]:
    heading, lines = "", list[tuple[int, str]]()
    for number, line in enumerate(text.split("\n"), start=1):
        if re.fullmatch(r"[a-z]+", line):
            yield heading, Section(tuple(lines))
            heading, lines = line, []
        elif line.strip():
            lines.append((number, line))
    yield heading, Section(tuple(lines))


def _lines(sections: dict[str, Section], heading: str) -> tuple[tuple[int, str], ...]:
    if heading not in sections:
        raise DesignError(
            f"the text has no section {heading!r}: write the heading, even with nothing under it"
        )
    return sections[heading].lines


def _parse_line(number: int, line: str, index: int) -> tuple[Operation, str, str]:
    head = re.match(rf"%{index} = (\w+)", line)
    if head is None or head[1] not in _CLASSES:
        raise misread(number, line, f"%{index} = and an operation such as 'add %0 %1'")
    cls = _CLASSES[head[1]]
    found = re.fullmatch(rf"%\d+ = {_body(cls)}(?: : ([^#]*?))?(?:  # (.*))?", line)
    if found is None:
        words = " ".join(_FIELDS[f.name].example for f in fields(cls))
        raise misread(number, line, f"'%{index} = {head[1]} {words}'")
    *words_found, note, origin = found.groups()
    try:
        values = [_FIELDS[f.name].read(word) for f, word in zip(fields(cls), words_found, strict=True)]
    except (ValueError, OverflowError, ZeroDivisionError, FormatError) as error:
        raise misread(number, line, f"a value that is one: {error}") from None
    operation = cls(*values)
    if any(k >= index for k in operands(operation)):
        raise misread(number, line, f"operands that stand before %{index}")
    return operation, note or "", _parse_origin(origin)


def _parse_root(number: int, line: str, count: int) -> tuple[str, int]:
    found = re.fullmatch(rf"({_NAME}) = %(\d+)", line)
    if found is None or int(found[2]) >= count:
        raise misread(number, line, f"'x[0] = %7' with an operation below %{count}")
    return parse_name(found[1]), int(found[2])


def _origin(origin: str) -> str:
    plain = origin.isprintable() and origin == origin.strip() and not origin.startswith('"')
    return origin if plain else json.dumps(origin)


def _parse_origin(text: str | None) -> str:
    return parse_name(text) if text else ""


def _body(cls: type[Operation]) -> str:
    words = (rf" ({_FIELDS[f.name].pattern})" for f in fields(cls))
    return _MNEMONICS[cls] + "".join(words)


def _print_constant(value: Fraction) -> str:
    try:
        exact = Fraction(float(value)) == value
    except OverflowError:
        exact = False
    return repr(float(value)) if exact else f"{value.numerator}/{value.denominator}"


def _parse_constant(text: str) -> Fraction:
    # A float's shortest digits name the float, not the decimal.
    return Fraction(text) if "/" in text else Fraction(float(text))


def _print_rows(rows: tuple[Fraction, ...]) -> str:
    return ",".join(map(_print_constant, rows))


def _parse_rows(text: str) -> tuple[Fraction, ...]:
    return tuple(map(_parse_constant, text.split(",")))


_TERM = r"-?%\d+\*%\d+"


def _print_terms(terms: tuple[Product, ...]) -> str:
    return ",".join(f"{'-' if term.negative else ''}%{term.a}*%{term.b}" for term in terms)


def _parse_terms(text: str) -> tuple[Product, ...]:
    found = re.findall(r"(-?)%(\d+)\*%(\d+)", text)
    return tuple(Product(int(a), int(b), bool(sign)) for sign, a, b in found)


@dataclass(frozen=True, slots=True)
class _Field:
    """How a field of an operation is written and read."""

    pattern: str
    example: str
    written: Callable[[Any], str]
    read: Callable[[str], Any]


_OPERAND = _Field(r"%\d+", "%0", lambda k: f"%{k}", lambda word: int(word[1:]))
_FIELDS = {
    "name": _Field(_NAME, "x[0]", print_name, parse_name),
    "value": _Field(r"[-+.\w/]+", "0.5", _print_constant, _parse_constant),
    "rows": _Field(r"[-+.\w/,]+", "0.5,0.25", _print_rows, _parse_rows),
    "terms": _Field(rf"{_TERM}(?:,{_TERM})*", "%0*%1,-%2*%3", _print_terms, _parse_terms),
    "exponent": _Field(r"-?\d+", "-3", str, int),
    "function": _Field(r"\w+", "sine", lambda function: function.value, Function),
    "form": _Field(_FORMAT, "fixed(16, fraction=8)", str, parse_format),
    "rounding": _Field(r"\w+", "half_up", lambda rounding: rounding.value, Rounding),
    "overflow": _Field(r"\w+", "saturate", lambda overflow: overflow.value, Overflow),
    "flag": _OPERAND,
    "a": _OPERAND,
    "b": _OPERAND,
}
