"""How the instructions of a pipelined core overlap: who works in which clock, and when a result is there.

An instruction takes its operands in one clock, ``issue``. What it writes goes to the data store in the clock
``issue + latency``, and an instruction that issues in that clock can have it. The array of multipliers takes
an instruction for ``passes`` clocks. What it computes of floating-point numbers comes ``behind`` its passes.
"""

from dataclasses import dataclass
from enum import Enum
from functools import cache

from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION, Core, writes
from kalmanhdl.processor.float_stages import product_registers, reciprocal_registers, sum_registers
from kalmanhdl.processor.function_stages import function_clocks
from kalmanhdl.processor.instructions import (
    ACCUMULATING,
    MINORS,
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

_OF_ARRAY = {
    Opcode.MULT_33,
    Opcode.MULT_33T,
    *SPLIT,
    Opcode.ADJ_33,
    Opcode.DET_33,
    *VECTORS,
    *SYMMETRIC,
}
_FLOAT_SUMS = {Opcode.ADD_33, Opcode.SUB_33}


class Factors(Enum):
    """Where a factor comes from."""

    A = "the first source"
    B = "the second source"
    COFACTORS = "those of the first row, found before"
    ONE = "one"


@dataclass(frozen=True, slots=True)
class Term:
    """A product in a sum: the places of its factors, and where each of them comes from."""

    left: int
    right: int
    of: tuple[Factors, Factors] = (Factors.A, Factors.B)


@dataclass(frozen=True, slots=True)
class Task:
    """An element of the result: what a unit computes in a pass, or part of its multipliers alone.

    ``differs``: the second term is taken from the first. A ``cofactor`` is no result yet.
    """

    element: int
    terms: tuple[Term, ...]
    differs: bool = False
    cofactor: bool = False


class Depth(Enum):
    """How far an element goes through a unit: a product alone, a pair of them, the sum of all, and what it is
    accumulated with."""

    PRODUCT = "product"
    PAIR = "pair"
    SUM = "sum"
    ACCUMULATED = "accumulated"


_PAIRS = {*_FLOAT_SUMS, Opcode.ADJ_33}


def depth_of(opcode: Opcode) -> Depth:
    """Of an instruction of the array."""
    if opcode in SPLIT:
        return Depth.PRODUCT
    if opcode in _PAIRS:
        return Depth.PAIR
    return Depth.ACCUMULATED if opcode in ACCUMULATING else Depth.SUM


def depth_clocks(depth: Depth, core: Core) -> int:
    """Clocks of floating-point elements from a pass to the clock in which they are found, beyond the next."""
    form = core.float_form
    clocks = product_registers(form) + 1
    levels = (core.size - 1).bit_length()
    added = {Depth.PRODUCT: 0, Depth.PAIR: 1, Depth.SUM: levels, Depth.ACCUMULATED: levels + 1}[depth]
    return clocks + added * (sum_registers(form) + 1)


def uses_array(opcode: Opcode, core: Core) -> bool:
    """Whether an instruction is one of the multipliers; sums of floats take the adders behind these."""
    return core.has(opcode) and (opcode in _OF_ARRAY or (core.floating and opcode in _FLOAT_SUMS))


def tasks_of_a_unit(opcode: Opcode, core: Core) -> int:
    """Elements that a unit computes in a pass."""
    if opcode in SPLIT:
        return core.size
    return core.size // 2 if core.floating and opcode in (*_PAIRS, Opcode.DET_33) else 1


@cache
def passes_of(opcode: Opcode, core: Core) -> tuple[tuple[Task, ...], ...]:
    """The tasks of the units, pass after pass; () for an instruction that is not the array's.

    The second source is a matrix by then: a vector its first column, a number on its diagonal.
    """
    tasks = _tasks(opcode, core) if uses_array(opcode, core) else []
    step = core.sums * tasks_of_a_unit(opcode, core)
    found = tuple(tuple(tasks[k : k + step]) for k in range(0, len(tasks), step))
    if core.floating and opcode is Opcode.DET_33:
        # The array waits for the cofactors, and sums their products with the first row.
        wait = ((),) * (depth_clocks(Depth.PAIR, core) + 1)
        terms = tuple(Term(k, k, (Factors.A, Factors.COFACTORS)) for k in range(core.size))
        return (*found, *wait, (Task(0, terms),))
    return found


def _tasks(opcode: Opcode, core: Core) -> list[Task]:
    n = core.size
    match opcode:
        case Opcode.ADJ_33:
            return [_minor(e, MINORS[e % n * n + e // n]) for e in range(core.elements)]
        case Opcode.DET_33:
            return [_minor(e, MINORS[e], cofactor=True) for e in range(n)]
        case Opcode.ADD_33 | Opcode.SUB_33:
            return [_pair(e, differs=opcode is Opcode.SUB_33) for e in range(core.elements)]
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


def _minor(element: int, places: tuple[int, int, int, int], *, cofactor: bool = False) -> Task:
    p, q, r, s = places
    of = (Factors.A, Factors.A)
    return Task(element, (Term(p, q, of), Term(r, s, of)), differs=True, cofactor=cofactor)


def _pair(element: int, *, differs: bool) -> Task:
    terms = (Term(element, 0, (Factors.A, Factors.ONE)), Term(element, 0, (Factors.B, Factors.ONE)))
    return Task(element, terms, differs=differs)


def passes(opcode: Opcode, core: Core) -> int:
    """Clocks for which an instruction has the array of multipliers."""
    return len(passes_of(opcode, core))


@cache
def behind(opcode: Opcode, core: Core) -> int:
    """Clocks from the last pass of an instruction of the array to its result, beyond the next one."""
    if core.floating:
        return depth_clocks(depth_of(opcode), core)
    return AFTER_COFACTORS if opcode is Opcode.DET_33 else 0


def reciprocal_clocks(core: Core) -> int:
    """Registers between the divisor and its reciprocal."""
    return reciprocal_registers(core.float_form) if core.floating else RECIPROCAL_REGISTERS


@cache
def latency(opcode: Opcode, core: Core) -> int:
    """Clocks from issue to the write; 0 for an instruction that writes no matrix."""
    if not writes(Instruction(opcode), core):
        return 0
    if opcode is Opcode.RECIP:
        return 1 + reciprocal_clocks(core)
    if opcode is Opcode.FUNC:
        return 1 + function_clocks(core)
    if uses_array(opcode, core):
        return 1 + passes(opcode, core) + behind(opcode, core)
    return 1


@cache
def clocks_of_instruction(opcode: Opcode, core: Core) -> int:
    """Clocks of an instruction on a core that does one at a time: eight, or eight as often as it needs.

    The operands of FUNC stand from the third clock on, its result is taken in the seventh. Floating-point
    operands stand from the third clock on, those of the array from the sixth; their result is taken in the
    eighth.
    """
    if not core.has(opcode):
        return CLOCKS_PER_INSTRUCTION
    if core.floating:
        taken = _ARRAY_STARTS if uses_array(opcode, core) else _OPERANDS_STAND
        late = taken + latency(opcode, core) - (CLOCKS_PER_INSTRUCTION - 1)
    else:
        late = function_clocks(core) - (CLOCKS_PER_INSTRUCTION - 4) if opcode is Opcode.FUNC else 0
    return CLOCKS_PER_INSTRUCTION * (1 + -(-max(late, 0) // CLOCKS_PER_INSTRUCTION))


_OPERANDS_STAND, _ARRAY_STARTS = 2, 5
"""Clocks of an instruction that does not overlap before it can take its operands."""


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
