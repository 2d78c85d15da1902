"""A step of a filter's program: which instruction works in which clocks, with peripherals that never wait."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from kalmanhdl.processor.clocks import Retired
from kalmanhdl.processor.compiler.generate import rows_read, tokens
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.disassembler import text_of
from kalmanhdl.processor.fit import Fitted
from kalmanhdl.processor.instructions import Opcode, encode
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.program import Program
from kalmanhdl.processor.simulator import Machine
from kalmanhdl.processor.timing import clocks_of_instruction, latency, uses_array

UNITS = ("products", "reciprocals", "functions", "sums and moves", "input and output", "jumps")
"""Who works on instructions."""

_PASSES = 9
_SETTLING = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Timed:
    """An instruction of a step: the clocks, from the step's first one, from its own first to its last.

    ``does`` is the program's comment, ``unit`` who works on it.
    """

    address: int
    first: int
    last: int
    text: str
    does: str
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """The last of several passes, instruction by instruction; the mean clocks and instructions of a pass."""

    clocks: float
    instructions: float
    rows: tuple[Timed, ...]


def step_of(fit: Fitted) -> Step:
    """A step of a design's program."""
    rows = _PASSES + _SETTLING + 1
    z = np.zeros((rows + fit.filter_.points, fit.model.m))
    u = np.zeros((len(z), fit.model.p))
    read = tokens(fit.filter_, fit.core, rows_read(fit.core, z, u))
    machine = Machine(fit.core, *bench(fit.core, read))
    machine.load(fit.program.words)
    begin = fit.program.labels["step"]
    done: list[Retired] = []
    begins: list[int] = []
    while len(begins) < rows:
        one = machine.retire()
        if one.address == begin:
            begins.append(len(done))
        done.append(one)
    first, before, last = begins[_SETTLING], begins[-2], begins[-1]
    return Step(
        clocks=(done[last].clock - done[first].clock) / _PASSES,
        instructions=(last - first) / _PASSES,
        rows=tuple(_timed(done[before:last], fit.program, fit.core)),
    )


def _timed(done: list[Retired], program: Program, core: Core) -> Iterator[Timed]:
    lines = program.source.splitlines()
    start = done[0].clock - _before(done[0].instruction.opcode, core)
    for one in done:
        opcode = one.instruction.opcode
        behind = max(latency(opcode, core) - 1, 0) if core.pipelined else 0
        line = lines[program.lines[one.address] - 1] if program.lines else ""
        yield Timed(
            address=one.address,
            first=one.clock - _before(opcode, core) - start,
            last=one.clock + behind - start,
            text=text_of(encode(one.instruction)),
            does=line.partition("--")[2].strip(),
            unit=_unit(opcode, core),
        )


def _before(opcode: Opcode, core: Core) -> int:
    """Clocks of an instruction before the one in which it takes effect."""
    return 0 if core.pipelined else clocks_of_instruction(opcode, core) - 1


def _unit(opcode: Opcode, core: Core) -> str:
    if opcode in (Opcode.READ, Opcode.WRITE, Opcode.JUMP_DRDY, Opcode.JUMP_ACK):
        return "input and output"
    if opcode is Opcode.RECIP:
        return "reciprocals"
    if opcode is Opcode.FUNC:
        return "functions"
    if uses_array(opcode, core) and opcode not in (Opcode.ADD_33, Opcode.SUB_33):
        return "products"
    return "sums and moves" if latency(opcode, core) else "jumps"
