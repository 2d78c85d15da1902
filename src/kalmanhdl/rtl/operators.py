"""The arithmetic cores that multiplications and divisions of a plan are made of."""

from amaranth.hdl import Shape

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.division_structure import ONE, Operand, in_one_table
from kalmanhdl.graph.operations import Divide, Reciprocal
from kalmanhdl.rtl.divider import LongDivider
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal
from kalmanhdl.rtl.reciprocal_table import ReciprocalTable
from kalmanhdl.schedule.plan import Plan


def multiplier(plan: Plan, index: int, a: Shape, b: Shape) -> Multiplier:
    """The core of a multiplication, for operands of these shapes."""
    on_block = index in plan.on_multiplier_block
    return Multiplier(a, b, plan.registers[index], on_block, plan.typed.logic_product)


def divider(plan: Plan, index: int) -> LongDivider | TableNewtonReciprocal | ReciprocalTable:
    """The core of a division or, without the port ``dividend``, of a reciprocal."""
    operation, typed = plan.typed.graph.operations[index], plan.typed
    form, rounding, registers = typed.formats[index], typed.division_rounding, plan.registers[index]
    assert form is not None
    match operation, typed.division:
        case Reciprocal(a), TableNewton() as method if in_one_table(_operand(plan, a), method):
            return ReciprocalTable(_operand(plan, a), form, rounding, method, registers)
        case Reciprocal(a), TableNewton() as method:
            on_block = index in plan.on_multiplier_block
            return TableNewtonReciprocal(_operand(plan, a), form, rounding, method, registers, on_block)
        case Reciprocal(a), LongDivision(radix=radix):
            return LongDivider(ONE, _operand(plan, a), form, rounding, radix, registers)
        case Divide(a, b), method:
            # A table gives reciprocals only; a quotient is always found by long division.
            radix = method.radix if isinstance(method, LongDivision) else 2
            return LongDivider(_operand(plan, a), _operand(plan, b), form, rounding, radix, registers)
    raise AssertionError(operation)


def _operand(plan: Plan, index: int) -> Operand:
    form, interval = plan.typed.formats[index], plan.typed.intervals[index]
    assert form is not None
    assert interval is not None
    return Operand(form=form, low=interval.low, high=interval.high)
