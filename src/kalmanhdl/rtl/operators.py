"""The arithmetic cores of a plan's multiplications and divisions."""

from amaranth.hdl import Module, Value

from kalmanhdl.arithmetic.division import LongDivision
from kalmanhdl.arithmetic.division_structure import ONE, Operand
from kalmanhdl.graph.operations import Divide, Multiply, Reciprocal
from kalmanhdl.rtl.divider import LongDivider
from kalmanhdl.rtl.stages import delayed
from kalmanhdl.schedule.plan import Plan


def product(m: Module, name: str, plan: Plan, index: int, a: Value, b: Value) -> Value:
    """The exact product, ``plan.registers[index]`` clocks after its operands."""
    assert isinstance(plan.typed.graph.operations[index], Multiply)
    return delayed(m, a * b, plan.registers[index], f"{name}_stage")


def quotient(m: Module, name: str, plan: Plan, index: int, divisor: Value, dividend: Value | None) -> Value:
    """The quotient, or without a dividend the reciprocal, so many clocks after its operands."""
    operation, typed = plan.typed.graph.operations[index], plan.typed
    form = typed.formats[index]
    assert isinstance(operation, Divide | Reciprocal)
    assert form is not None
    assert isinstance(typed.division, LongDivision)
    core = LongDivider(
        ONE if isinstance(operation, Reciprocal) else _operand(plan, operation.a),
        _operand(plan, operation.a if isinstance(operation, Reciprocal) else operation.b),
        form,
        typed.division_rounding,
        typed.division.radix,
        plan.registers[index],
    )
    m.submodules[f"{name}_divider"] = core
    m.d.comb += core.divisor.eq(divisor)
    if dividend is not None:
        m.d.comb += core.dividend.eq(dividend)
    return core.quotient


def _operand(plan: Plan, index: int) -> Operand:
    form, interval = plan.typed.formats[index], plan.typed.intervals[index]
    assert form is not None
    assert interval is not None
    return Operand(form=form, low=interval.low, high=interval.high)
