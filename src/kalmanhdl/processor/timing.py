"""How the instructions of a pipelined core overlap: who works in which clock, and when a result is there.

An instruction takes its operands in one clock, ``issue``. What it writes goes to the data store in the clock
``issue + latency``, and an instruction that issues in that clock can have it. The array of multipliers takes
an instruction for ``passes`` clocks.
"""

from dataclasses import dataclass
from functools import cache

from kalmanhdl.processor.arithmetic import MINORS
from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION, Core, writes
from kalmanhdl.processor.function_stages import function_clocks
from kalmanhdl.processor.instructions import (
    ACCUMULATING,
    SYMMETRIC,
    VECTORS,
    Instruction,
    Kind,
    Opcode,
)

RECIPROCAL_REGISTERS = 4
"""Between the divisor and its reciprocal."""

AFTER_COFACTORS = 2
"""Clocks from the cofactors of a row to their sum, the determinant."""

FRONT_CLOCKS = 1
"""From the clock in which a word is there to the one in which its instruction issues at best."""

JUMP_CLOCKS = 2
"""From a jump that is taken to the instruction that it goes to."""

QUEUE = 16
"""Numbers that wait on the way in, and on the way out."""

SPLIT = {Opcode.MULT_3S, Opcode.SCALE, Opcode.HAD_33, Opcode.OUTER_33}
"""The instructions whose elements are a product each, so that every multiplier has its own."""

OF_ARRAY = {
    Opcode.MULT_33,
    Opcode.MULT_33T,
    *SPLIT,
    Opcode.ADJ_33,
    Opcode.DET_33,
    *VECTORS,
    *SYMMETRIC,
}
"""The instructions of the multipliers."""


@dataclass(frozen=True, slots=True)
class Term:
    """A product in a sum: the places of its factors, both in the first source if ``minor``."""

    left: int
    right: int
    minor: bool = False
    subtracted: bool = False


@dataclass(frozen=True, slots=True)
class Task:
    """An element of the result: what a unit computes in a pass, or one of its multipliers alone."""

    element: int
    terms: tuple[Term, ...]


@cache
def passes_of(opcode: Opcode, core: Core) -> tuple[tuple[Task, ...], ...]:
    """The tasks of the units, pass after pass; () for an instruction that is not the array's.

    The second source is a matrix by then: a vector its first column, a number on its diagonal.
    """
    tasks = _tasks(opcode, core) if opcode in OF_ARRAY and core.has(opcode) else []
    step = core.units * (core.size if opcode in SPLIT else 1)
    return tuple(tuple(tasks[k : k + step]) for k in range(0, len(tasks), step))


def _tasks(opcode: Opcode, core: Core) -> list[Task]:
    n = core.size
    match opcode:
        case Opcode.ADJ_33:
            return [_minor(e, MINORS[e % n * n + e // n]) for e in range(core.elements)]
        case Opcode.DET_33:
            return [_minor(e, MINORS[e]) for e in range(n)]
        case Opcode.HAD_33:
            return [Task(e, (Term(e, e),)) for e in range(core.elements)]
        case Opcode.OUTER_33:
            return [Task(n * i + j, (Term(i, j),)) for i in range(n) for j in range(n)]
        case _ if opcode in SPLIT:
            return [Task(e, (Term(e, e % n * (n + 1)),)) for e in range(core.elements)]
        case _ if opcode in VECTORS:
            return [_dot(i, i, 0, n) for i in range(n)]
        case _ if opcode in SYMMETRIC:
            return [_dot(n * i + j, i, j, n) for i in range(n) for j in range(i, n)]
        case _:
            return [_dot(n * i + j, i, j, n) for i in range(n) for j in range(n)]


def _dot(element: int, i: int, j: int, n: int) -> Task:
    return Task(element, tuple(Term(n * i + k, n * k + j) for k in range(n)))


def _minor(element: int, places: tuple[int, int, int, int]) -> Task:
    p, q, r, s = places
    return Task(element, (Term(p, q, minor=True), Term(r, s, minor=True, subtracted=True)))


def passes(opcode: Opcode, core: Core) -> int:
    """Clocks for which an instruction has the array of multipliers."""
    return len(passes_of(opcode, core))


@cache
def latency(opcode: Opcode, core: Core) -> int:
    """Clocks from issue to the write; 0 for an instruction that writes no matrix."""
    if not writes(Instruction(opcode), core):
        return 0
    if opcode is Opcode.RECIP:
        return 1 + RECIPROCAL_REGISTERS
    if opcode is Opcode.FUNC:
        return 1 + function_clocks(core)
    if opcode in OF_ARRAY:
        return 1 + passes(opcode, core) + (AFTER_COFACTORS if opcode is Opcode.DET_33 else 0)
    return 1


@cache
def clocks_of_instruction(opcode: Opcode, core: Core) -> int:
    """Clocks of an instruction on a core that does one at a time: eight, or eight as often as FUNC needs.

    Its operands stand from the third clock on, its result is taken in the seventh.
    """
    if opcode is not Opcode.FUNC or not core.has(opcode):
        return CLOCKS_PER_INSTRUCTION
    late = max(function_clocks(core) - (CLOCKS_PER_INSTRUCTION - 4), 0)
    return CLOCKS_PER_INSTRUCTION * (1 + -(-late // CLOCKS_PER_INSTRUCTION))


def sources(instruction: Instruction) -> tuple[int, ...]:
    """The matrices that an instruction reads."""
    operands = instruction.operation.operands
    first_two = [
        instruction.arguments[each.argument]
        for each in operands
        if each.kind is Kind.MATRIX and each.argument < 2
    ]
    if instruction.opcode is Opcode.READ or not first_two:
        return ()
    accumulates = instruction.opcode in ACCUMULATING
    return (*first_two, instruction.arguments[2]) if accumulates else tuple(first_two)
