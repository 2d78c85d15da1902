"""The vectors as tables in text, one number a cell, for programs in any language to read."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from io import StringIO

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.interface import Interface, Port
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.testbench.sections import Section
from kalmanhdl.testbench.vectors import Transfers, Vectors
from kalmanhdl.toolchain.harness import Stream
from kalmanhdl.verify.border import streams_of

Row = Sequence[object]


def tables(vectors: Vectors, plan: Plan, shown: Interface) -> dict[str, str]:
    """Every table by the name of its file."""
    found = {
        "ports.csv": ports(plan, shown),
        "held.csv": (("port",), *((name,) for name, _ in shown.loading)),
        "sections.csv": (("section", "wait"), *(_section(section) for section in vectors.sections)),
        "stimulus.csv": transfers(vectors.stimulus, shown, "in"),
        "expected.csv": transfers(vectors.expected, shown, "out"),
    }
    return {name: _text(rows) for name, rows in found.items()}


def ports(plan: Plan, shown: Interface) -> Iterator[Row]:
    """Every port that carries a number: its width in bits, and what a raw integer on it stands for."""
    yield "stream", "column", "port", "width", "signed", "signal", "format", "last_bit"
    known = {port.name: port for port in (*shown.numbers, *shown.present, *shown.outputs)}
    for prefix, pair in zip(shown.streams, streams_of(shown), strict=True):
        for stream in pair:
            for name, width in stream.payload:
                column = name.removeprefix(prefix)
                yield prefix, column, name, width, *_meaning(column, known.get(column), plan)


def _meaning(column: str, port: Port | None, plan: Plan) -> Row:
    if port is None:
        return 0, column.split("_")[1], "", ""
    match port.form:
        case Fixed():
            # float() of an exact power of two times the scale: the same text on every machine.
            last_bit = float(port.form.resolution) * plan.typed.scales.get(port.signal, 1.0)
            return int(port.signed), port.signal, port.form, repr(last_bit)
        case Float():
            return 0, port.signal, port.form, ""
        case None:
            return 0, port.signal, "", ""


def transfers(tokens: Iterable[Transfers], shown: Interface, way: str) -> Iterator[Row]:
    """A row a token: where it belongs, when it comes, and hexadecimal digits for every port."""
    source, sink = streams_of(shown)[0]
    widths = _widths(source if way == "in" else sink, shown.streams[0])
    clock = () if way == "in" else ("clock",)
    yield "section", "stream", "pause", *clock, *widths
    for one in tokens:
        pauses = one.pauses.tolist()
        clocks = [""] * len(pauses) if one.clocks is None else one.clocks.tolist()
        columns = [_hexadecimal(one.numbers[name].tolist(), width) for name, width in widths.items()]
        for pause, due, *cells in zip(pauses, clocks, *columns, strict=True):
            yield one.section, one.stream, pause, *((due,) if clock else ()), *cells


def _widths(stream: Stream, prefix: str) -> dict[str, int]:
    return {name.removeprefix(prefix): width for name, width in stream.payload}


def _hexadecimal(raws: list[int], width: int) -> list[str]:
    mask, digits = (1 << width) - 1, -(-width // 4)
    return [f"{int(raw) & mask:0{digits}x}" for raw in raws]


def _section(section: Section) -> Row:
    return section.name, section.wait


def _text(rows: Iterable[Row]) -> str:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
