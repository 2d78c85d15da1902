"""How many registers floating-point operators have: so much logic fits a clock of a core.

No device is asked: the clocks are part of the core's time, which is the same wherever it is placed. Pieces of
logic and their weights are those of ``float_structure``, as for hardware of a filter's own.
"""

from collections.abc import Sequence
from functools import cache

from kalmanhdl.arithmetic.float_structure import Piece, addition, division, multiplication, weights
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.arithmetic.pipelining import longest_stage
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.schedule.float_operators import float_pieces

_LONGEST = 5.6
"""Levels of adders between registers: about as long as the way of a result to the instruction that waits."""


def _registers(pieces: Sequence[Piece]) -> int:
    """The fewest registers inside an operator of which no stage is too long."""
    chain, registers = weights(tuple(pieces)), 0
    while longest_stage(chain, registers) > _LONGEST:
        registers += 1
    return registers


@cache
def product_registers(form: Float) -> int:
    """Of a multiplier. One more register takes its result."""
    return _registers(multiplication(form, on_block=True))


@cache
def sum_registers(form: Float) -> int:
    """Of an adder. One more register takes its result."""
    return _registers(addition(form))


@cache
def reciprocal_registers(form: Float) -> int:
    """Of a divider."""
    return _registers(division(form))


def float_registers(typed: FloatGraph, index: int) -> int:
    """Of the operator of an operation."""
    return _registers(float_pieces(typed, index, on_block=True))
