"""A program beside double precision, as text: instruction by instruction, row by row, and its store."""

from collections.abc import Iterator, Mapping
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.disassembler import text_of
from kalmanhdl.processor.instructions import encode
from kalmanhdl.processor.program import Program
from kalmanhdl.processor.reference_steps import ReferenceSteps
from kalmanhdl.processor.shadow import Deviation, Shadow
from kalmanhdl.processor.simulator import Machine

Array = NDArray[np.float64]
Rows = list[tuple[str, ...]]

_NAMED = 3


def instruction_rows(shadow: Shadow, program: Program) -> Rows:
    """A row an instruction whose result was ever off double precision, or did not fit, by address."""
    found = sorted(shadow.deviations.values(), key=lambda one: one.address)
    shown = [one for one in found if one.off or one.misfits]
    head = (
        "address",
        "instruction",
        "computes",
        "times",
        "largest",
        "off at most",
        "of it",
        "where",
        "misfits",
    )
    rows = [_row(one, program, shadow.core) for one in shown]
    return [head, *rows, ("", f"{len(found) - len(shown)} others: exact", *[""] * 7)]


def _row(one: Deviation, program: Program, core: Core) -> tuple[str, ...]:
    i, j = divmod(one.element, core.size)
    share = one.off / one.largest if one.largest else 0.0
    return (
        f"{one.address:03X}",
        *_text(one, program),
        str(one.times),
        f"{one.largest:.4g}",
        f"{one.off:.2g}",
        f"{share:.1e}",
        f"[{i},{j}], time {one.time}" if one.off else "",
        str(one.misfits or ""),
    )


def _text(one: Deviation, program: Program) -> tuple[str, str]:
    """An instruction as the source has it, and its comment."""
    if program.lines:
        source, _, comment = program.source.splitlines()[program.lines[one.address] - 1].partition("--")
        words = source.partition(":")[2] or source if ":" in source else source
        if not words.strip()[:8].isalnum():
            return " ".join(words.split()), comment.strip()
    return text_of(encode(one.instruction)), ""


def worst(shadow: Shadow, program: Program) -> Iterator[str]:
    """The instructions that are farthest off beside their largest results, in words."""
    found = [one for one in shadow.deviations.values() if one.off]
    for one in islice(sorted(found, key=lambda one: -one.off / one.largest), _NAMED):
        text, comment = _text(one, program)
        i, j = divmod(one.element, shadow.core.size)
        what = f" ({comment})" if comment else ""
        yield (
            f"address {one.address:03X}, {text}{what}: element [{i},{j}] is {one.off:.2g} off "
            f"{one.value:.6g}, time {one.time}: {one.off / one.largest:.1e} of its largest"
        )


def step_rows(found: ReferenceSteps) -> Rows:
    """A row a number that is put out: how far it is off the float reference, and after which row."""
    rows: Rows = [
        ("number", "unit", "largest", "off at most", "after row", "root mean square off", "of largest")
    ]
    for k, (name, unit) in enumerate(zip(found.names, found.units, strict=True)):
        off, value = found.off[:, k], np.abs(found.reference[:, k])
        if not np.isfinite(off).any():
            continue
        at, largest = int(np.nanargmax(off)), float(np.nanmax(value))
        mean = float(np.sqrt(np.nanmean(off**2)))
        share = f"{off[at] / largest:.1e}" if largest else ""
        rows.append((name, unit or "-", f"{largest:.6g}", f"{off[at]:.3g}", str(at), f"{mean:.2g}", share))
    return rows


def step_lines(found: ReferenceSteps) -> Rows:
    """A row a row of data: every number that is put out, and how far it is off."""
    head = [text for name in found.names for text in (name, "off")]
    rows: Rows = [("row", *head)]
    for k, (values, off) in enumerate(zip(found.exact, found.off, strict=True)):
        if np.isfinite(off).any():
            cells = [text for pair in zip(values, off, strict=True) for text in _cells(*pair)]
            rows.append((str(k), *cells))
    return rows


def _cells(value: float, off: float) -> tuple[str, str]:
    return f"{value:.8g}", f"{off:.1e}"


def store_text(
    machine: Machine, shadow: Shadow, program: Program, units: Mapping[str, Array]
) -> Iterator[str]:
    """The matrices that are not zero beside those of double precision.

    ``units`` (size, size) are what one of an element is, for those that have one; the others are shown as
    they stand.
    """
    core, names = machine.core, dict[int, str]()
    for name, address in program.matrices.items():
        names.setdefault(address, name)
    shape = (core.size, core.size)
    for address, raws in enumerate(machine.data):
        if not any(raws):
            continue
        name = names.get(address, "")
        unit = units.get(name, np.ones(shape))
        exact = np.reshape(core.numbers.reals(raws), shape) * unit
        real = shadow.data[address].reshape(shape) * unit
        off = float(np.abs(exact - real).max())
        where = ", in the units of the model" if name in units else ""
        yield f"{name} ({address})".strip() + f"{where}: at most {off:.2g} off double precision"
        for row, beside in zip(exact, real, strict=True):
            yield "  " + _numbers(row) + "   |   " + _numbers(beside)


def _numbers(row: Array) -> str:
    return " ".join(f"{value:>14.8g}" for value in row)
