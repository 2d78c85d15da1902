"""The arithmetic cores that multiplications and divisions of a plan are made of."""

from amaranth.hdl import Shape

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.division_structure import ONE, Operand, in_one_table
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.operations import operands
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.divider import IterativeDivider, LongDivider
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal
from kalmanhdl.rtl.reciprocal_table import ReciprocalTable
from kalmanhdl.schedule.plan import Plan


def multiplier(plan: Plan, index: int, a: Shape, b: Shape) -> Multiplier:
    """The core of a multiplication, for operands of these shapes."""
    assert isinstance(plan.typed, TypedGraph)
    on_block = index in plan.on_multiplier_block
    return Multiplier(a, b, plan.registers[index], on_block, plan.typed.logic_product)


def divider(plan: Plan, index: int) -> LongDivider | TableNewtonReciprocal | ReciprocalTable:
    """The core of a division or, without the port ``dividend``, of a reciprocal."""
    typed, form = plan.typed, plan.typed.formats[index]
    assert isinstance(typed, TypedGraph)
    assert isinstance(form, Fixed)
    reads = tuple(_operand(plan, k) for k in operands(typed.graph.operations[index]))
    return division(typed, reads, form, plan.registers[index], index in plan.on_multiplier_block)


def division(
    typed: TypedGraph, reads: tuple[Operand, ...], form: Fixed, registers: int, on_block: bool
) -> LongDivider | TableNewtonReciprocal | ReciprocalTable:
    """The core that divides the first operand by the second, or gives the reciprocal of the only one."""
    rounding, method = typed.division_rounding, typed.division
    if len(reads) == 1 and isinstance(method, TableNewton):
        if in_one_table(reads[0], method):
            return ReciprocalTable(reads[0], form, rounding, method, registers)
        return TableNewtonReciprocal(reads[0], form, rounding, method, registers, on_block)
    # A table gives reciprocals only; a quotient is always found by long division.
    radix = method.radix if isinstance(method, LongDivision) else 2
    dividend, divisor = reads if len(reads) == 2 else (ONE, reads[0])
    return LongDivider(dividend, divisor, form, rounding, radix, registers)


def iterative_division(typed: TypedGraph, reads: tuple[Operand, ...], form: Fixed) -> IterativeDivider:
    """The core of one row that divides the first operand by the second, or gives a reciprocal."""
    method = typed.division
    radix = method.radix if isinstance(method, LongDivision) else 2
    dividend, divisor = reads if len(reads) == 2 else (ONE, reads[0])
    return IterativeDivider(dividend, divisor, form, typed.division_rounding, radix)


def _operand(plan: Plan, index: int) -> Operand:
    assert isinstance(plan.typed, TypedGraph)
    form, interval = plan.typed.formats[index], plan.typed.intervals[index]
    assert form is not None
    assert interval is not None
    return Operand(form=form, low=interval.low, high=interval.high)
