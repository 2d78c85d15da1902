"""A typed graph as text, and back: the text of the graph with formats, intervals and scales.

%7 = multiply %3 %5 : fixed(24, fraction=12) [-32768, 32767]  # update: K[1,0]
"""

import re

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.floating import MODES, Float
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.errors import DesignError
from kalmanhdl.graph.kinds import KINDS
from kalmanhdl.graph.operations import is_flag
from kalmanhdl.graph.text import (
    GraphText,
    misread,
    parse_format,
    parse_graph_text,
    parse_name,
    print_graph,
    print_name,
)
from kalmanhdl.numerics.floating import FloatGraph, Unbounded
from kalmanhdl.numerics.typed import Interval, TypedGraph, Violation


def print_typed_graph(typed: TypedGraph | FloatGraph) -> str:
    """The text of a typed graph, or of one in floating point."""
    if isinstance(typed, FloatGraph):
        return _print_float_graph(typed)
    notes = [
        f"{form} [{interval.low}, {interval.high}]" if form and interval else ""
        for form, interval in zip(typed.formats, typed.intervals, strict=True)
    ]
    lines = ["division", f"{_print_method(typed.division)} {typed.division_rounding.value}"]
    lines += ["multiplication", f"in logic {typed.logic_product.value}", "violations"]
    lines += map(_print_violation, typed.violations)
    lines += ["scales", *(f"{print_name(name)} = {scale!r}" for name, scale in typed.scales.items())]
    return print_graph(typed.graph, notes) + "\n".join(lines) + "\n"


def _print_float_graph(typed: FloatGraph) -> str:
    form = typed.form
    kept = "subnormals" if form.subnormals else "no_subnormals"
    lines = ["floating", f"{form} {form.rounding.value} {kept}", "fused"]
    lines += [f"%{index}" for index in sorted(typed.fused)]
    lines += ["clocks", *(f"{kind} {count}" for kind, count in typed.clocks)]
    lines += ["violations", *map(_print_unbounded, typed.violations)]
    lines += ["scales", *(f"{print_name(name)} = {scale!r}" for name, scale in typed.scales.items())]
    return print_graph(typed.graph) + "\n".join(lines) + "\n"


def parse_typed_graph(text: str) -> TypedGraph | FloatGraph:
    """The graph that ``print_typed_graph`` wrote. Raises DesignError with a line not understood."""
    found = parse_graph_text(text)
    if "floating" in found.sections:
        return _parse_float_graph(found)
    missing = {"division", "multiplication", "violations", "scales"} - found.sections.keys()
    if missing:
        raise DesignError(
            f"the text has no section {min(missing)!r}: a typed graph has division, multiplication, "
            "violations and scales"
        )
    formats, intervals = _parse_notes(found)
    method, rounding = _parse_division(*found.sections["division"].lines[0])
    return TypedGraph(
        found.graph,
        formats,
        intervals,
        method,
        rounding,
        tuple(_parse_violation(*line) for line in found.sections["violations"].lines),
        dict(_parse_scale(*line) for line in found.sections["scales"].lines),
        _parse_product(*found.sections["multiplication"].lines[0]),
    )


def _parse_float_graph(found: GraphText) -> FloatGraph:
    missing = {"fused", "clocks", "violations", "scales"} - found.sections.keys()
    if missing:
        raise DesignError(
            f"the text has no section {min(missing)!r}: a graph in floating point has fused, clocks, "
            "violations and scales"
        )
    return FloatGraph(
        graph=found.graph,
        form=_parse_float(*found.sections["floating"].lines[0]),
        fused=frozenset(_parse_index(*line) for line in found.sections["fused"].lines),
        violations=tuple(_parse_unbounded(*line) for line in found.sections["violations"].lines),
        scales=dict(_parse_scale(*line) for line in found.sections["scales"].lines),
        clocks=tuple(_parse_clocks(*line) for line in found.sections["clocks"].lines),
    )


def _parse_clocks(number: int, line: str) -> tuple[str, int]:
    kind, _, count = line.partition(" ")
    if kind not in KINDS or not re.fullmatch(r"\d+", count):
        raise misread(number, line, "a kind of operator and its clocks, 'add 7'")
    return kind, int(count)


def _parse_float(number: int, line: str) -> Float:
    found = re.fullmatch(r"float\((\d+), (\d+)\) (\w+) (no_)?subnormals", line)
    if found is None or found[3] not in {mode.value for mode in MODES}:
        raise misread(number, line, "'float(8, 23) half_even subnormals' or the like")
    return Float(int(found[1]), int(found[2]), Rounding(found[3]), not found[4])


def _parse_index(number: int, line: str) -> int:
    if not re.fullmatch(r"%\d+", line):
        raise misread(number, line, "an operation, '%4'")
    return int(line[1:])


def _print_unbounded(violation: Unbounded) -> str:
    when = [word for word in ("starting", "running") if getattr(violation, word)]
    return " ".join((f"%{violation.value}", *when))


def _parse_unbounded(number: int, line: str) -> Unbounded:
    found = re.fullmatch(r"%(\d+)( starting)?( running)?", line)
    if found is None:
        raise misread(number, line, "'%4 starting running'")
    return Unbounded(value=int(found[1]), starting=bool(found[2]), running=bool(found[3]))


def _parse_notes(found: GraphText) -> tuple[tuple[Fixed | None, ...], tuple[Interval | None, ...]]:
    formats: list[Fixed | None] = []
    intervals: list[Interval | None] = []
    lines = found.sections["operations"].lines
    for operation, note, (number, line) in zip(found.graph.operations, found.notes, lines, strict=True):
        parts = re.fullmatch(r"(\w+\(\d+, fraction=-?\d+\)) \[(-?\d+), (-?\d+)\]", note)
        if (parts is None) != is_flag(operation):
            raise misread(
                number, line, "' : fixed(16, fraction=8) [-5, 7]' behind a number, nothing behind a flag"
            )
        formats.append(parse_format(parts[1]) if parts else None)
        intervals.append(Interval(low=int(parts[2]), high=int(parts[3])) if parts else None)
    return tuple(formats), tuple(intervals)


def _print_method(method: DivisionMethod) -> str:
    if isinstance(method, LongDivision):
        return f"long_division(radix={method.radix})"
    return f"table_newton(index_bits={method.index_bits}, iterations={method.iterations})"


def _parse_division(number: int, line: str) -> tuple[DivisionMethod, Rounding]:
    long = re.fullmatch(r"long_division\(radix=(\d+)\) (\w+)", line)
    table = re.fullmatch(r"table_newton\(index_bits=(\d+), iterations=(\d+)\) (\w+)", line)
    found = long or table
    if found is None or found.groups()[-1] not in {r.value for r in Rounding}:
        raise misread(number, line, "'long_division(radix=2) half_up' or the like")
    rounding = Rounding(found.groups()[-1])
    if long:
        return LongDivision(radix=int(found[1])), rounding
    return TableNewton(index_bits=int(found[1]), iterations=int(found[2])), rounding


def _parse_product(number: int, line: str) -> LogicProduct:
    written = {f"in logic {kind.value}": kind for kind in LogicProduct}
    if line not in written:
        raise misread(number, line, " or ".join(map(repr, written)))
    return written[line]


def _print_violation(violation: Violation) -> str:
    when = [word for word in ("starting", "running") if getattr(violation, word)]
    return " ".join((f"%{violation.quantise} %{violation.outside}", *when))


def _parse_violation(number: int, line: str) -> Violation:
    found = re.fullmatch(r"%(\d+) %(\d+)( starting)?( running)?", line)
    if found is None:
        raise misread(number, line, "'%4 %5 starting running'")
    return Violation(
        quantise=int(found[1]), outside=int(found[2]), starting=bool(found[3]), running=bool(found[4])
    )


def _parse_scale(number: int, line: str) -> tuple[str, float]:
    name, separator, scale = line.rpartition(" = ")
    try:
        value = float(scale)
    except ValueError:
        separator = ""
    if not separator:
        raise misread(number, line, "'x[0] = 0.5'")
    return parse_name(name), value
