"""A program in double precision beside the simulator: how far off is every instruction's result."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from kalmanhdl.graph.functions import value_of
from kalmanhdl.graph.operations import Function
from kalmanhdl.processor.clocks import Retired
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import FUNCTIONS, Instruction, Opcode

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """An instruction of a program over all times that it was done.

    ``off`` is the largest distance of an element of its result from double precision, at ``element`` when it
    was done for the ``time``-th time, and ``value`` the element in double precision then; ``largest`` is the
    largest magnitude that any had. ``misfits`` counts the times a result did not fit the format.
    """

    address: int
    instruction: Instruction
    times: int = 0
    largest: float = 0.0
    off: float = 0.0
    value: float = 0.0
    element: int = 0
    time: int = 0
    misfits: int = 0


@dataclass(slots=True)
class Shadow:
    """The data store in double precision, kept by ``follow`` as the machine retires instructions.

    What is read is the same number; jumps are those of the machine. Nothing is rounded to the format and
    nothing saturates, but a fixed-point reciprocal of what is not positive is the format's largest number.
    """

    core: Core
    data: list[Array] = field(init=False)
    deviations: dict[int, Deviation] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.data = [np.zeros(self.core.elements) for _ in range(self.core.matrices)]

    def follow(self, done: Retired) -> float:
        """Do the same; how far off the result of the machine is at most."""
        if not done.elements:
            return 0.0
        first, second, third = done.instruction.arguments
        exact = self.core.numbers.reals(done.values)
        if done.instruction.opcode is Opcode.READ:
            result = exact
        else:
            a, b, c = self.data[first], self.data[second % self.core.matrices], self.data[third]
            with np.errstate(all="ignore"):
                result = real_result(done.instruction, a, b, c, self.core)
        self.data[third] = self.data[third].copy()
        self.data[third][done.elements.start : done.elements.stop] = result
        off = _apart(exact, result)
        self._note(done, result, off)
        return float(off.max())

    def _note(self, done: Retired, result: Array, off: Array) -> None:
        before = self.deviations.get(
            done.address, Deviation(address=done.address, instruction=done.instruction)
        )
        worst = int(np.argmax(off))
        further = off[worst] > before.off
        self.deviations[done.address] = Deviation(
            address=done.address,
            instruction=done.instruction,
            times=before.times + 1,
            largest=max(before.largest, float(np.abs(result).max())),
            off=float(off[worst]) if further else before.off,
            value=float(result[worst]) if further else before.value,
            element=done.elements.start + worst if further else before.element,
            time=before.times + 1 if further else before.time,
            misfits=before.misfits + done.saturated,
        )


def real_result(instruction: Instruction, a: Array, b: Array, c: Array, core: Core) -> Array:
    """The elements that an arithmetic instruction writes, of real matrices, row after row.

    As ``arithmetic.compute``, without its rounding.
    """
    n, element = core.size, instruction.arguments[1]
    A, B, C = (each.reshape(n, n) for each in (a, b, c))
    match instruction.opcode:
        case Opcode.COPY:
            return a
        case Opcode.TRANS_33:
            return np.ravel(A.T)
        case Opcode.MASK_33:
            return np.where(np.diag(B)[:, None] != 0, A, 0.0).ravel()
        case Opcode.PICK:
            return a[element : element + 1]
        case Opcode.PLACE:
            return a[:1]
        case Opcode.FUNC:
            function = FUNCTIONS[instruction.arguments[1]]
            below = function is Function.SQUARE_ROOT and a[0] < 0
            lost = np.nan if core.floating else 0.0
            return np.atleast_1d(lost if below else value_of(function, a[0], a[1]))
        case Opcode.RECIP:
            inverts = core.floating or a[element] > 0
            return np.atleast_1d(1 / a[element] if inverts else core.numbers.limits[1])
        case Opcode.ADD_33:
            return a + b
        case Opcode.SUB_33:
            return a - b
        case Opcode.MULT_31:
            return np.asarray(A @ B[0])
        case Opcode.MADD_31:
            return np.asarray(C[0] + A @ B[0])
        case Opcode.MSUB_31:
            return np.asarray(C[0] - A @ B[0])
        case Opcode.MULT_33:
            return np.ravel(A @ B)
        case Opcode.MULT_33T:
            return np.ravel(A @ B.T)
        case Opcode.SYMADD_33:
            return _mirrored(C + A @ B.T)
        case Opcode.SYMSUB_33:
            return _mirrored(C - A @ B.T)
        case Opcode.MULT_3S:
            return np.asarray(a * b[0])
        case Opcode.SCALE:
            return np.asarray(np.ldexp(a, instruction.operands[1]))
        case Opcode.HAD_33:
            return a * b
        case Opcode.OUTER_33:
            return np.outer(A[0], B[0]).ravel()
        case Opcode.ADJ_33:
            return np.ravel(_cofactors(A).T)
        case Opcode.DET_33:
            return np.array([A[0] @ _cofactors(A)[0]])
        case _:
            raise AssertionError(instruction)


def _apart(exact: Array, result: Array) -> Array:
    """How far elements are apart; infinities of one sign are not, and NaN is infinitely far from a number."""
    same = (exact == result) | (np.isnan(exact) & np.isnan(result))
    with np.errstate(invalid="ignore"):
        return np.where(same, 0.0, np.nan_to_num(np.abs(exact - result), nan=np.inf, posinf=np.inf))


def _mirrored(matrix: Array) -> Array:
    return np.asarray(np.triu(matrix) + np.triu(matrix, 1).T).ravel()


def _cofactors(A: Array) -> Array:
    """Of a 3 by 3 matrix: its rows are products of the others."""
    return np.array([np.cross(A[(i + 1) % 3], A[(i + 2) % 3]) for i in range(3)])
