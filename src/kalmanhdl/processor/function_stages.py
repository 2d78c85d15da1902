"""In which clock each operation of a core's functions works: so many levels of logic fit a clock.

No device is asked: the clocks are part of the core's time, which is the same wherever it is placed.
"""

from functools import cache
from typing import assert_never

from kalmanhdl.arithmetic.fixed import Fixed, stands_below
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Bits,
    Constant,
    Divide,
    Flag,
    Input,
    Multiply,
    Negative,
    Not,
    NotFinite,
    Operation,
    Or,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    StateFlag,
    Subtract,
    SumOfProducts,
    SumOutside,
    Table,
    Unary,
    operands,
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.float_stages import float_registers
from kalmanhdl.processor.functions import function_graph
from kalmanhdl.schedule.plan import Plan

_LEVELS = 6
"""Two rotations of CORDIC: as long as a product and its sum, which other instructions have in a clock."""


@cache
def function_plan(core: Core) -> Plan:
    """The functions of a core on operators of their own, each in the earliest clock that has room for it."""
    typed = function_graph(core).typed
    start, registers = _of_floats(typed) if isinstance(typed, FloatGraph) else _of_integers(typed)
    products = (k for k, each in enumerate(typed.graph.operations) if isinstance(each, Multiply))
    return Plan(
        typed=typed,
        start=start,
        registers=registers,
        on_multiplier_block=frozenset(products),
        interval=1,
        channels=1,
        distance=1,
        context_overhead=0,
        recurrence_bound=1,
        least_interval=1,
        least_latency=1,
        period_ns=0.0,
        pipelined_period_ns=0.0,
    )


def _of_integers(typed: TypedGraph) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """When operations of one clock or less take their operands; none has registers inside."""
    start: list[int] = []
    depth: list[int] = []
    for operation in typed.graph.operations:
        clock, levels = _ready(operation, _levels(operation, typed), start, depth)
        start.append(clock)
        depth.append(levels)
    return tuple(start), (0,) * len(start)


def _of_floats(typed: FloatGraph) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """When operators take their operands, and the registers inside them; one more takes a result."""
    operations = typed.graph.operations
    registers = tuple(float_registers(typed, index) for index in range(len(operations)))
    start: list[int] = []
    for operation in operations:
        waits = 0 if isinstance(operation, NotFinite) else 1
        ends = [
            start[k] + (0 if isinstance(operations[k], _WITHOUT_REGISTER) else registers[k] + waits)
            for k in operands(operation)
        ]
        start.append(max(ends, default=0))
    return tuple(start), registers


_WITHOUT_REGISTER = (Input, Flag, Constant, Select, Negative)
"""Operations of so little logic that no register takes their results."""


def function_clocks(core: Core) -> int:
    """Clocks from the arguments to the values of all functions of a core."""
    return function_plan(core).latency - 1


def _ready(operation: Operation, own: int, start: list[int], depth: list[int]) -> tuple[int, int]:
    """The clock of an operation of ``own`` levels, and those from its beginning to the result."""
    reads = operands(operation)
    clock = max((start[k] for k in reads), default=0)
    levels = max((depth[k] for k in reads if start[k] == clock), default=0)
    return (clock + 1, own) if own and levels + own > _LEVELS else (clock, levels + own)


def _levels(operation: Operation, typed: TypedGraph) -> int:
    """The levels of logic of an operation; a carry counts as two."""
    match operation:
        case Input() | Flag() | Constant() | Shift() | Bits() | Negative() | Not():
            return 0
        case Select() | And() | Or():
            return 1
        case Add(a, b) if _joined(typed.formats[a], typed.formats[b]):
            return 0
        case Add() | Subtract() | Quantise() | Outside() | Table():
            return 2
        case Multiply():
            return 4
        case SumOfProducts() | SumOutside():
            raise AssertionError(f"{operation}: functions have an operator for every operation")
        case State() | StateFlag() | Divide() | Reciprocal() | Unary() | Binary() | NotFinite():
            raise AssertionError(f"{operation} in the graph of a function")
        case _:
            assert_never(operation)


def _joined(a: Fixed | None, b: Fixed | None) -> bool:
    """Whether a sum is the bits of the one behind those of the other."""
    assert a is not None
    assert b is not None
    return stands_below(a, b) or stands_below(b, a)
