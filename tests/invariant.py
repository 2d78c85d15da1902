"""Bounds that hardware never leaves, whatever it is sent, and its Verilog with what follows from them.

The states start at zero. Where every step of states within bounds, with any data and any commands, ends
within them, they hold for ever, also for states that a reset left half written.
"""

import re
from collections.abc import Iterator
from fractions import Fraction

from kalmanhdl.arithmetic.fixed import rounded
from kalmanhdl.graph.operations import Add, Outside, Quantise, Reciprocal, Shift, State, Subtract
from kalmanhdl.numerics.interval import of_format, reciprocal_interval, type_of
from kalmanhdl.numerics.typed import Interval, TypedGraph
from kalmanhdl.rtl.names import operation_names

# Rounds in which bounds may grow by themselves, before they are set to those of the format.
_PATIENCE = 8

# For an operation, what it is a multiple of, and how often.
_Multiple = tuple[int, Fraction]


def bounds(typed: TypedGraph) -> tuple[Interval | None, ...]:
    """What the value of each operation stays within, none for flags. Zero, of registers that have had nothing
    yet, is within all of them."""
    operations = typed.graph.operations
    formats = {
        op.name: form
        for op, form in zip(operations, typed.formats, strict=True)
        if form is not None and isinstance(op, State)
    }
    states = {name: Interval(low=0, high=0) for name in formats}
    for number in range(1000):
        found = _of_step(typed, states)
        grown = {
            name: _joined(states[name], found[root]) for name, root in typed.graph.states if name in states
        }
        if grown == states:
            return found
        wide = number >= _PATIENCE
        states = {
            name: _widened(states[name], new, formats[name]) if wide else new for name, new in grown.items()
        }
    raise AssertionError("bounds that are widened come to rest")


def _widened(old, new, form):
    limit = of_format(form)
    return Interval(
        low=new.low if new.low == old.low else limit.low,
        high=new.high if new.high == old.high else limit.high,
    )


def _of_step(typed: TypedGraph, states: dict[str, Interval]) -> tuple[Interval | None, ...]:
    types, found, multiples = [], [], []
    for index, (operation, form, widest) in enumerate(
        zip(typed.graph.operations, typed.formats, typed.intervals, strict=True)
    ):
        if form is None:
            types.append(None), found.append(None), multiples.append((index, Fraction(1)))
            continue
        if isinstance(operation, State):
            own = states[operation.name]
        elif isinstance(operation, Reciprocal):
            own = reciprocal_interval(types[operation.a], form, typed.division_rounding, typed.division)
        else:
            exact, own = type_of(operation, types, form)
            assert exact.fraction == form.fraction, operation
        multiples.append(_multiple(index, operation, multiples))
        own = _met(_met(own, widest), _of_multiple(typed, multiples[-1], index, found))
        found.append(_joined(own, Interval(low=0, high=0)))
        types.append((form, found[-1]))
    return tuple(found)


def _multiple(index, operation, multiples) -> _Multiple:
    match operation:
        case Shift(a, exponent):
            base, times = multiples[a]
            return base, times * Fraction(2) ** exponent
        case Add(a, b) | Subtract(a, b) if multiples[a][0] == multiples[b][0]:
            sign = 1 if isinstance(operation, Add) else -1
            return multiples[a][0], multiples[a][1] + sign * multiples[b][1]
        case _:
            return index, Fraction(1)


def _of_multiple(typed, multiple: _Multiple, index: int, found) -> Interval:
    base, times = multiple
    if base == index:
        return typed.intervals[index]
    factor = times * Fraction(2) ** (typed.formats[index].fraction - typed.formats[base].fraction)
    ends = sorted((found[base].low * factor, found[base].high * factor))
    return Interval(low=int(ends[0]), high=int(ends[1]))


def _joined(a: Interval, b: Interval) -> Interval:
    return Interval(low=min(a.low, b.low), high=max(a.high, b.high))


def _met(a: Interval, b: Interval) -> Interval:
    # Bounds of nothing: an approximate reciprocal may miss its own.
    return (
        Interval(low=max(a.low, b.low), high=min(a.high, b.high))
        if a.low <= b.high and b.low <= a.high
        else b
    )


def assumed(verilog: str, typed: TypedGraph) -> tuple[str, frozenset[str]]:
    """The Verilog, in whose datapath bits that are always zero are read as such, and the wires that do so."""
    module = re.search(r"^module \S+\.datapath \(.*?^endmodule", verilog, re.MULTILINE | re.DOTALL)
    text, wires = module[0], set()
    for name, used in _used_bits(typed):
        for high, wire in re.findall(
            rf"^ +(?:wire|reg) (?:\[(\d+):0\] )?({name}(?:_c\d+)?)(?: = [^;]+)?;$", text, re.MULTILINE
        ):
            width = int(high or 0) + 1
            if used >= width:
                continue
            wires.add(f"datapath.{wire}_known")
            low = f", {wire}[{used - 1}:0]" if used else ""
            size = f"[{width - 1}:0] " if high else ""
            known = f"  wire {size}{wire}_known = {{ {width - used}'h0{low} }};"
            lines = [_reading(line, wire) for line in text.splitlines()]
            place = next(
                k for k, line in enumerate(lines) if re.fullmatch(rf" +(wire|reg).* {wire}( = .*)?;", line)
            )
            text = "\n".join([*lines[: place + 1], known, *lines[place + 1 :]])
    return verilog.replace(module[0], text), frozenset(wires)


def _used_bits(typed: TypedGraph) -> Iterator[tuple[str, int]]:
    """The names of numbers and flags that are never negative, and how many bits they ever need."""
    held = bounds(typed)
    for index, (name, operation) in enumerate(
        zip(operation_names(typed.graph), typed.graph.operations, strict=True)
    ):
        if (own := held[index]) is not None and own.low >= 0:
            yield name, own.high.bit_length()
        if isinstance(operation, Quantise | Outside):
            before = _rounded(operation, typed.formats[operation.a], held[operation.a])
            if isinstance(operation, Quantise) and before.low >= 0:
                yield f"{name}_rounded", before.high.bit_length()
            form = operation.form
            if isinstance(operation, Outside) and form.lowest <= before.low <= before.high <= form.highest:
                yield name, 0


def _rounded(operation, form, interval: Interval) -> Interval:
    """What a number is after its rounding, and before it is brought into its format."""
    dropped = form.fraction - operation.form.fraction
    low, high = (rounded(end, dropped, operation.rounding) for end in (interval.low, interval.high))
    return Interval(low=low, high=high)


def _reading(line: str, wire: str) -> str:
    """A line that reads the known bits of a wire instead of the wire."""
    target, sign, source = (
        re.split(r"( <?= )", line, maxsplit=1) if re.search(r" <?= ", line) else (line, "", "")
    )
    if not sign or target.lstrip().startswith(("wire", "reg")):
        return line
    return target + sign + re.sub(rf"(?<![\w$.\\]){wire}(?![\w$.])", f"{wire}_known", source)
