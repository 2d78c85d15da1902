"""What the arithmetic instructions compute, on raw integers: exact, then brought into the format once."""

from collections.abc import Sequence
from operator import mul

from kalmanhdl.arithmetic.fixed import quantise
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import Opcode

Matrix = Sequence[int]
"""The raw elements of a matrix, row after row."""


def exact(opcode: Opcode, a: Matrix, b: Matrix, core: Core) -> tuple[list[int], int]:
    """The exact elements that an instruction writes, and by how many times the format's fraction they have.

    A vector stands in the first row: its elements are 0 to N - 1. A number is element 0.
    """
    n = core.size
    match opcode:
        case Opcode.ADD_33:
            return [x + y for x, y in zip(a, b, strict=True)], 1
        case Opcode.MULT_31:
            return [_dot(a[i : i + n], b[:n]) for i in range(0, n * n, n)], 2
        case Opcode.MULT_33:
            columns = [b[j::n] for j in range(n)]
            return [_dot(a[i : i + n], column) for i in range(0, n * n, n) for column in columns], 2
        case Opcode.MULT_3S:
            return [x * b[0] for x in a], 2
        case Opcode.DET_33:
            return [_determinant(a)], 3
        case _:
            raise AssertionError(opcode)


def compute(opcode: Opcode, a: Matrix, b: Matrix, core: Core) -> tuple[list[int], bool]:
    """The raw elements that an instruction writes, and whether any of them did not fit."""
    values, times = exact(opcode, a, b, core)
    fraction = times * core.form.fraction
    found = [quantise(value, fraction, core.form, core.rounding, core.overflow) for value in values]
    return [raw for raw, _ in found], any(outside for _, outside in found)


def _dot(a: Matrix, b: Matrix) -> int:
    return sum(map(mul, a, b))


def _determinant(a: Matrix) -> int:
    """Of a 3 by 3 matrix, as bhatia2012 has it (section 2.1, KF ALU)."""
    return sum(a[e] * (a[p] * a[q] - a[r] * a[s]) for e, p, q, r, s in _MINORS)


_MINORS = ((0, 4, 8, 7, 5), (1, 5, 6, 8, 3), (2, 3, 7, 6, 4))
"""Element, and the elements of the two products whose difference is its cofactor."""
