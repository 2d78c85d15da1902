"""What the arithmetic instructions compute on floating-point numbers: every operation rounds once.

Products round, then their sum does, neighbours first (``float_arrays.summed``), then what is accumulated.
"""

from collections.abc import Sequence

import numpy as np

from kalmanhdl.arithmetic.float_arrays import FloatArrays, Numbers, float_arrays, summed
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import MINORS, Instruction, Opcode

Matrix = Sequence[int]

_P, _Q, _R, _S = np.array(MINORS).T


def float_elements(instruction: Instruction, a: Matrix, b: Matrix, c: Matrix, core: Core) -> list[int]:
    """The raw elements of a result that is computed, not moved."""
    arrays, n = float_arrays(core.float_form), core.size
    A = arrays.load(a).reshape(n, n)
    if instruction.opcode is Opcode.RECIP:
        return arrays.store(arrays.divide(_power(core, 0), A.ravel()[instruction.arguments[1]]))
    if instruction.opcode is Opcode.SCALE:
        return arrays.store(arrays.multiply(A, _power(core, instruction.operands[1])))
    if instruction.opcode is Opcode.ADJ_33:
        return arrays.store(_cofactors(arrays, A).T)
    if instruction.opcode is Opcode.DET_33:
        return arrays.store(summed(arrays, arrays.multiply(A[0], _cofactors(arrays, A)[0])))
    B = arrays.load(b).reshape(n, n)
    if instruction.opcode in _OF_TWO:
        return arrays.store(_of_two(arrays, instruction.opcode, A, B))
    return arrays.store(_accumulated(arrays, instruction.opcode, A, B, c))


_OF_TWO = {
    Opcode.ADD_33,
    Opcode.SUB_33,
    Opcode.MULT_3S,
    Opcode.HAD_33,
    Opcode.OUTER_33,
    Opcode.MULT_31,
    Opcode.MULT_33,
    Opcode.MULT_33T,
}


def _of_two(arrays: FloatArrays, opcode: Opcode, A: Numbers, B: Numbers) -> Numbers:
    match opcode:
        case Opcode.ADD_33:
            return arrays.add(A, B)
        case Opcode.SUB_33:
            return arrays.subtract(A, B)
        case Opcode.MULT_3S:
            return arrays.multiply(A, B[0, 0])
        case Opcode.HAD_33:
            return arrays.multiply(A, B)
        case Opcode.OUTER_33:
            return arrays.multiply(A[0, :, None], B[0])
        case Opcode.MULT_31:
            return _times(arrays, A, B[:1].T)[:, 0]
        case Opcode.MULT_33:
            return _times(arrays, A, B)
        case Opcode.MULT_33T:
            return _times(arrays, A, B.T)
        case _:
            raise AssertionError(opcode)


def _accumulated(arrays: FloatArrays, opcode: Opcode, A: Numbers, B: Numbers, c: Matrix) -> Numbers:
    """The destination and a product, or less it."""
    joined = arrays.subtract if opcode in (Opcode.SYMSUB_33, Opcode.MSUB_31) else arrays.add
    C = arrays.load(c).reshape(A.shape)
    if opcode in (Opcode.MADD_31, Opcode.MSUB_31):
        return joined(C[0], _times(arrays, A, B[:1].T)[:, 0])
    assert opcode in (Opcode.SYMADD_33, Opcode.SYMSUB_33), opcode
    upper = joined(C, _times(arrays, A, B.T))
    rows, columns = np.indices(A.shape)
    return upper[np.minimum(rows, columns), np.maximum(rows, columns)]


def _times(arrays: FloatArrays, A: Numbers, B: Numbers) -> Numbers:
    return summed(arrays, arrays.multiply(A[:, None, :], B.T[None, :, :]))


def _cofactors(arrays: FloatArrays, A: Numbers) -> Numbers:
    """Two products and their difference each."""
    a = A.ravel()
    return arrays.subtract(arrays.multiply(a[_P], a[_Q]), arrays.multiply(a[_R], a[_S])).reshape(3, 3)


def _power(core: Core, exponent: int) -> Numbers:
    """Two to a power, which is a number of the format."""
    return float_arrays(core.float_form).load([core.numbers.nearest(2.0**exponent)])
