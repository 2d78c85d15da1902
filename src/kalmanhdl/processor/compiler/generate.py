"""The source of a compiled filter, and what it reads."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kalmanhdl.algorithm import Algorithm
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.model import Model
from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.compiler.allocate import Places, allocate
from kalmanhdl.processor.compiler.constants import (
    TURN,
    cleared_source,
    input_lines,
    numbers_read,
    read_source,
    readings,
)
from kalmanhdl.processor.compiler.graph import Computed, Constant, Given, Held, Put, Read, Section
from kalmanhdl.processor.compiler.schedule import scheduled
from kalmanhdl.processor.compiler.trace import Block, Traced, traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import OPERATIONS, Kind
from kalmanhdl.processor.program import Program


def compiled(filter_: Traced, core: Core) -> Program:
    """The program of a filter for a core.

    Raises ProgramError where it does not fit the core's stores, or scales by what is no number of the core.
    """
    lacking = sorted(filter_.exponents - set(core.exponents))
    if lacking:
        raise ProgramError(
            f"the program scales by two to the power {lacking[0]}, which is no number of {core.form}: "
            "take more bits on that side of the point"
        )
    return assemble(source(filter_, core), core, "the filter's program")


def fitting(model: Model, algorithm: Algorithm, core: Core) -> Traced:
    """A filter whose program fits the stores of a core: a row in one section, or else with loops.

    Raises ProgramError where neither does, or where there is none.
    """
    fast = traced(model, algorithm, core.size)
    core = equipped(core, fast)
    try:
        compiled(fast, core)
    except ProgramError:
        short = traced(model, algorithm, core.size, short=True)
        compiled(short, core)
        return short
    return fast


def equipped(core: Core, filter_: Traced) -> Core:
    """A core with the functions that a filter needs."""
    return replace(core, functions=filter_.functions)


def source(filter_: Traced, core: Core) -> str:
    """The program's source: it clears its matrices, reads the constants, and filters for ever."""
    parts = _parts(filter_, core)
    read = readings(filter_, core)
    sections = [block.section for part in parts for block in part]
    places = allocate(filter_, sections, core, turns=any(one.looped for one in read))
    # A float that is no number does not leave by products with zeros.
    whole = set() if core.floating else {one.name for one in read if one.looped}
    cleared = [name for name in places.names if name not in whole]
    lines = [".text", *cleared_source(cleared, core)]
    lines += read_source(read, {TURN: places.spare}, core)
    *starts, step, shared = parts
    for start in starts:
        lines += _part(start, places, core)
        if shared and filter_.joins:
            lines.append(f"{'':16}JUMP_U   {shared[0].section.name}")
    lines += [*_part(step, places, core), *_part(shared, places, core), f"{'':16}JUMP_U   step"]
    return "\n".join([*lines, ".data", *(f"{name}:" for name in places.names)]) + "\n"


def _parts(filter_: Traced, core: Core) -> list[tuple[Block, ...]]:
    """The blocks of every start, those of a step, and those that follow them, their sections in order."""
    outputs = [
        (Constant(name) if name in filter_.constants else Held(name), element)
        for name, element in filter_.outputs
    ]

    def ordered(blocks: Sequence[Block], outputs: Sequence[tuple[Held | Constant, int]]) -> tuple[Block, ...]:
        """The first one puts out what the row before has left."""
        return tuple(
            replace(block, section=scheduled(block.section, core, outputs if k == 0 else ()))
            for k, block in enumerate(blocks)
        )

    starts = []
    for k in range(filter_.points):
        (start,) = filter_.start
        named = replace(start, section=replace(start.section, name=f"start{k}"))
        starts.append(ordered([named], outputs if k else ()))
    return [*starts, ordered(filter_.step, outputs), ordered(filter_.shared, ())]


def _part(blocks: Sequence[Block], places: Places, core: Core) -> Iterator[str]:
    for block in blocks:
        name = block.section.name
        yield f"{name + ':':<15} -- {name}"
        if block.times > 1:
            yield f"{'':16}LOOP     {block.times}"
            yield f"{name}_pass:"
        yield from _section(block.section, places, core)
        if block.times > 1:
            yield f"{'':16}NEXT     {name}_pass"


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
    copies = [(of[result], name) for name, result in section.held.items() if of[result] != name]
    # What is copied from a matrix that stays is so before that one is.
    for place, name in sorted(copies, key=lambda copy: copy[0] not in section.held):
        yield f"{'':16}COPY     {place} {name}"


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
    one = core.numbers.nearest(1.0)
    return tuple(
        (
            *(0 if missed else one for missed in lost),
            *(core.numbers.nearest(value) for value in [*np.where(lost, 0.0, row).tolist(), *more.tolist()]),
        )
        for row, lost, more in zip(array, np.isnan(array), controls, strict=True)
    )


def tokens(filter_: Traced, core: Core, rows: Iterable[Sequence[int]]) -> tuple[int, ...]:
    """All that the program reads."""
    return (*numbers_read(filter_, core), *(number for row in rows for number in row))
