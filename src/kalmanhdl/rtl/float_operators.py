"""The arithmetic cores of a floating-point plan: ports ``a``, and ``b`` and ``c`` if any, to ``result``."""

from amaranth.lib.wiring import Component

from kalmanhdl.graph.operations import (
    Add,
    Divide,
    Function,
    Multiply,
    Reciprocal,
    Shift,
    Subtract,
    Table,
    Unary,
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.rtl.floating.adder import FloatAdder
from kalmanhdl.rtl.floating.divider import FloatDivider
from kalmanhdl.rtl.floating.fused import FloatFused
from kalmanhdl.rtl.floating.multiplier import FloatMultiplier
from kalmanhdl.rtl.floating.scaler import FloatScaler
from kalmanhdl.rtl.floating.square_root import FloatSquareRoot
from kalmanhdl.rtl.floating.table import FloatTable
from kalmanhdl.rtl.floating.wrapper import FloatWrapper
from kalmanhdl.schedule.plan import Plan


def core(plan: Plan, index: int, registers: int) -> Component:
    """The core of an operation, its result so many clocks after its operands."""
    typed = plan.typed
    assert isinstance(typed, FloatGraph)
    form, on_block = typed.form, index in plan.on_multiplier_block
    fused = typed.fused_sum(index)
    if fused is not None:
        signs = {"minus_product": fused.minus_product, "minus_addend": fused.minus_addend}
        return FloatFused(form, registers, on_block, **signs)
    match typed.graph.operations[index]:
        case Add():
            return FloatAdder(form, registers)
        case Subtract():
            return FloatAdder(form, registers, difference=True)
        case Multiply():
            return FloatMultiplier(form, registers, on_block)
        case Divide():
            return FloatDivider(form, registers)
        case Reciprocal():
            return FloatDivider(form, registers, reciprocal=True)
        case Shift(exponent=exponent):
            return FloatScaler(form, exponent, registers)
        case Unary(function=function):
            kind = FloatWrapper if function is Function.WRAP else FloatSquareRoot
            return kind(form, registers)
        case Table(rows=rows):
            return FloatTable(form, tuple(map(form.nearest, rows)), registers)
        case operation:
            raise AssertionError(f"{operation} has no core")
