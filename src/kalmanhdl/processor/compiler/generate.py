"""The source of a compiled filter, and what it reads."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.compiler.allocate import GIVEN, Places, allocate
from kalmanhdl.processor.compiler.evaluate import padded, raw_constant
from kalmanhdl.processor.compiler.graph import Computed, Given, Section
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import OPERATIONS, Kind
from kalmanhdl.processor.program import Program


def compiled(filter_: Traced, core: Core) -> Program:
    """The program of a filter for a core. Raises ProgramError where it does not fit the core's stores."""
    return assemble(source(filter_, core), core, "the filter's program")


def source(filter_: Traced, core: Core) -> str:
    """The program's source: it clears its matrices, reads the constants, and filters for ever."""
    places = allocate(filter_, core)
    lines = [".text", *(f"{'':16}SUB_33   {name} {name} {name}" for name in places.names)]
    for name, array in filter_.constants.items():
        lines.append(f"{'':16}-- {name}")
        for element in np.flatnonzero(padded(array, core.size)):
            lines += _input(f"{name}_{element}", int(element), name)
    if filter_.points > 1:
        lines.append(f"{'':16}LOOP     {filter_.points}")
    lines += [f"start:{'':10}-- start", *_section(filter_.start, places, "start")]
    if filter_.points > 1:
        lines.append(f"{'':16}NEXT     start")
    lines += [f"step:{'':11}-- step", *_section(filter_.step, places, "step"), f"{'':16}JUMP_U   step"]
    return "\n".join([*lines, ".data", *(f"{name}:" for name in places.names)]) + "\n"


def _input(label: str, element: int, name: str) -> Iterator[str]:
    yield f"{label + ':':<15} JUMP_DRDY {label}"
    yield f"{'':16}READ     {element} {name}"


def _section(section: Section, places: Places, prefix: str) -> Iterator[str]:
    of = places.of[section.name]
    for name in GIVEN:
        for node in section.nodes:
            if isinstance(node, Given) and node.name == name:
                for element in node.elements:
                    yield from _input(f"{prefix}_{name}{element}", element, name)
    for index in section.live:
        node = section.nodes[index]
        if isinstance(node, Computed):
            comment = f"  -- {section.comments[index]}" if index in section.comments else ""
            yield f"{'':16}{_instruction(node, of, index)}{comment}"
    for name, result in section.held.items():
        if of[result] != name:
            yield f"{'':16}COPY     {of[result]} {name}"
    results = {result: name for name, result in section.held.items()}
    for number, (out, element) in enumerate(section.outputs):
        label = f"{prefix}_out{number}"
        yield f"{label + ':':<15} JUMP_ACK {label}"
        yield f"{'':16}WRITE    {results.get(out, of[out])} {element}"


def _instruction(node: Computed, of: Mapping[int, str], index: int) -> str:
    sources = iter(node.sources)
    kinds = [operand.kind for operand in OPERATIONS[node.opcode.name].operands[:-1]]
    words = [of[next(sources)] if kind is Kind.MATRIX else str(node.immediate) for kind in kinds]
    return f"{node.opcode.name:<8} {' '.join([*words, of[index]])}"


def constants_read(filter_: Traced, core: Core) -> tuple[int, ...]:
    """The raw numbers that the program reads before the first row."""
    found: list[int] = []
    for name, array in filter_.constants.items():
        found += [raw for raw in raw_constant(name, array, core) if raw]
    return tuple(found)


def rows_read(core: Core, z: ArrayLike) -> tuple[tuple[int, ...], ...]:
    """The raw numbers that the program reads of each row of z (steps, m), NaN where missed.

    Measurements, then flags; what is missed is zero.
    """
    array = np.asarray(z, np.float64)
    one = core.form.nearest(1.0)
    return tuple(
        (
            *(
                0 if missed else core.form.nearest(float(value))
                for value, missed in zip(row, lost, strict=True)
            ),
            *(0 if missed else one for missed in lost),
        )
        for row, lost in zip(array, np.isnan(array), strict=True)
    )


def tokens(filter_: Traced, core: Core, rows: Iterable[Sequence[int]]) -> tuple[int, ...]:
    """All that the program reads."""
    return (*constants_read(filter_, core), *(number for row in rows for number in row))
