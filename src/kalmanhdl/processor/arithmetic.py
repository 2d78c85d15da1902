"""What the arithmetic instructions compute, on raw numbers.

In fixed point every element is exact, then brought into the format once; ``float_arithmetic`` has floats.
"""

from collections.abc import Sequence
from operator import mul

from kalmanhdl.arithmetic.division import reciprocal
from kalmanhdl.arithmetic.fixed import quantise
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.float_arithmetic import float_elements
from kalmanhdl.processor.functions import function_value
from kalmanhdl.processor.instructions import FUNCTIONS, MINORS, Instruction, Opcode

Matrix = Sequence[int]
"""The raw elements of a matrix, row after row."""


def compute(
    instruction: Instruction, a: Matrix, b: Matrix, core: Core, c: Matrix = ()
) -> tuple[list[int], bool]:
    """The raw elements that an instruction writes, and whether any of them did not fit, or is not finite.

    ``a`` and ``b`` are the matrices at its first and second argument, ``c`` the one at its third, which those
    that accumulate need. A vector stands in the first row: its elements are 0 to N - 1. A number is element
    0.
    """
    moved = _moved(instruction, a, b, core)
    if moved is not None:
        return moved, False
    if instruction.opcode is Opcode.FUNC:
        value, outside = function_value(core, FUNCTIONS[instruction.arguments[1]], a[0], a[1])
        return [value], outside
    if core.floating:
        form, elements = core.float_form, float_elements(instruction, a, b, c, core)
        return elements, any(form.magnitude(raw) >= form.infinity for raw in elements)
    if instruction.opcode is Opcode.RECIP:
        # The divisors of a filter are variances: of what is not positive the result is that of zero.
        fixed, divisor = core.fixed_form, a[instruction.arguments[1]]
        value, outside = reciprocal(max(divisor, 0), fixed.fraction, fixed, core.rounding, core.division)
        return [value], outside
    values, times = _exact(instruction, a, b, c, core)
    fraction = times * core.fixed_form.fraction
    found = [quantise(value, fraction, core.fixed_form, core.rounding, core.overflow) for value in values]
    return [raw for raw, _ in found], any(outside for _, outside in found)


def _moved(instruction: Instruction, a: Matrix, b: Matrix, core: Core) -> list[int] | None:
    """The result of an instruction that only moves elements; None for the others."""
    match instruction.opcode:
        case Opcode.COPY:
            return list(a)
        case Opcode.MASK_33:
            flags = [core.numbers.is_zero(b[row * (core.size + 1)]) for row in range(core.size)]
            return [0 if flags[e // core.size] else x for e, x in enumerate(a)]
        case Opcode.TRANS_33:
            return _transposed(a, core.size)
        case Opcode.PICK:
            return [a[instruction.arguments[1]]]
        case Opcode.PLACE:
            return [a[0]]
        case _:
            return None


def _exact(instruction: Instruction, a: Matrix, b: Matrix, c: Matrix, core: Core) -> tuple[list[int], int]:
    """The exact elements of a result, and by how many times the format's fraction they have."""
    n = core.size
    match instruction.opcode:
        case Opcode.ADD_33:
            return [x + y for x, y in zip(a, b, strict=True)], 1
        case Opcode.SUB_33:
            return [x - y for x, y in zip(a, b, strict=True)], 1
        case Opcode.MULT_31:
            return [_dot(a[i : i + n], b[:n]) for i in range(0, n * n, n)], 2
        case Opcode.MADD_31 | Opcode.MSUB_31:
            sign = -1 if instruction.opcode is Opcode.MSUB_31 else 1
            rows = range(n)
            return [_shifted(c[i], core) + sign * _dot(a[n * i : n * i + n], b[:n]) for i in rows], 2
        case Opcode.SYMADD_33 | Opcode.SYMSUB_33:
            sign = -1 if instruction.opcode is Opcode.SYMSUB_33 else 1
            products = _product(a, _transposed(b, n), n)
            upper = [_shifted(c[e], core) + sign * products[e] for e in range(n * n)]
            return [upper[min(e, e % n * n + e // n)] for e in range(n * n)], 2
        case Opcode.MULT_33:
            return _product(a, b, n), 2
        case Opcode.MULT_33T:
            return _product(a, _transposed(b, n), n), 2
        case Opcode.MULT_3S:
            return [x * b[0] for x in a], 2
        case Opcode.HAD_33:
            return [x * y for x, y in zip(a, b, strict=True)], 2
        case Opcode.OUTER_33:
            return [x * y for x in a[:n] for y in b[:n]], 2
        case Opcode.SCALE:
            _, exponent, _ = instruction.operands
            return [x << core.fixed_form.fraction + exponent for x in a], 2
        case Opcode.ADJ_33:
            return _transposed([_cofactor(a, element) for element in range(9)], n), 2
        case Opcode.DET_33:
            return [sum(a[element] * _cofactor(a, element) for element in range(3))], 3
        case _:
            raise AssertionError(instruction)


def _product(a: Matrix, b: Matrix, n: int) -> list[int]:
    columns = [b[j::n] for j in range(n)]
    return [_dot(a[i : i + n], column) for i in range(0, n * n, n) for column in columns]


def _shifted(number: int, core: Core) -> int:
    """A number with the fraction of a product."""
    return number << core.fixed_form.fraction


def _dot(a: Matrix, b: Matrix) -> int:
    return sum(map(mul, a, b))


def _transposed(a: Matrix, n: int) -> list[int]:
    return [x for j in range(n) for x in a[j::n]]


def _cofactor(a: Matrix, element: int) -> int:
    p, q, r, s = MINORS[element]
    return a[p] * a[q] - a[r] * a[s]
