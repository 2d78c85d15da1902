"""The source of a compiled filter, and what it reads."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.compiler.allocate import Places, allocate
from kalmanhdl.processor.compiler.constants import TURN, input_lines, numbers_read, read_source, readings
from kalmanhdl.processor.compiler.graph import Computed, Constant, Given, Held, Put, Read, Section
from kalmanhdl.processor.compiler.schedule import scheduled
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import OPERATIONS, Kind
from kalmanhdl.processor.program import Program


def compiled(filter_: Traced, core: Core) -> Program:
    """The program of a filter for a core. Raises ProgramError where it does not fit the core's stores."""
    return assemble(source(filter_, core), core, "the filter's program")


def source(filter_: Traced, core: Core) -> str:
    """The program's source: it clears its matrices, reads the constants, and filters for ever."""
    starts = [
        scheduled(replace(filter_.start, name=f"start{k}"), core, filter_.outputs if k else ())
        for k in range(filter_.points)
    ]
    step = scheduled(filter_.step, core, filter_.outputs)
    read = readings(filter_, core)
    places = allocate(filter_, (*starts, step), core, turns=any(one.looped for one in read))
    whole = {one.name for one in read if one.looped}
    cleared = [name for name in places.names if name not in whole]
    lines = [".text", *(f"{'':16}SUB_33   {name} {name} {name}" for name in cleared)]
    lines += read_source(read, {TURN: places.spare}, core)
    for section in (*starts, step):
        lines += [f"{section.name + ':':<15} -- {section.name}", *_section(section, places, core)]
    lines.append(f"{'':16}JUMP_U   step")
    return "\n".join([*lines, ".data", *(f"{name}:" for name in places.names)]) + "\n"


def _output(label: str, element: int, name: str, core: Core) -> Iterator[str]:
    if not core.pipelined:
        yield f"{label + ':':<15} JUMP_ACK {label}"
    yield f"{'':16}WRITE    {name} {element}"


def _section(section: Section, places: Places, core: Core) -> Iterator[str]:
    of = places.of[section.name]
    for index, node in enumerate(section.nodes):
        match node:
            case Read(name, element):
                yield from input_lines(f"{section.name}_{name}{element}", element, name, core)
            case Put(source, element):
                yield from _output(f"{section.name}_out{index}", element, of[source], core)
            case Computed():
                comment = f"  -- {section.comments[index]}" if index in section.comments else ""
                yield f"{'':16}{_instruction(node, of, index)}{comment}"
            case Constant() | Held() | Given():
                pass
    for name, result in section.held.items():
        if of[result] != name:
            yield f"{'':16}COPY     {of[result]} {name}"


def _instruction(node: Computed, of: Mapping[int, str], index: int) -> str:
    sources = iter(node.sources)
    kinds = [operand.kind for operand in OPERATIONS[node.opcode.name].operands[:-1]]
    words = [of[next(sources)] if kind is Kind.MATRIX else str(node.immediate) for kind in kinds]
    return f"{node.opcode.name:<8} {' '.join([*words, of[index]])}"


def rows_read(core: Core, z: ArrayLike, u: ArrayLike | None = None) -> tuple[tuple[int, ...], ...]:
    """The raw numbers that the program reads of each row of z (steps, m), NaN where missed, and u (steps, p).

    Flags, then measurements, then controls; what is missed is zero.
    """
    array = np.asarray(z, np.float64)
    controls = np.zeros((len(array), 0)) if u is None else np.asarray(u, np.float64)
    one = core.form.nearest(1.0)
    return tuple(
        (
            *(0 if missed else one for missed in lost),
            *(core.form.nearest(value) for value in [*np.where(lost, 0.0, row).tolist(), *more.tolist()]),
        )
        for row, lost, more in zip(array, np.isnan(array), controls, strict=True)
    )


def tokens(filter_: Traced, core: Core, rows: Iterable[Sequence[int]]) -> tuple[int, ...]:
    """All that the program reads."""
    return (*numbers_read(filter_, core), *(number for row in rows for number in row))
