"""The stack of loops: how often each that stands open is still to be passed."""

from itertools import pairwise

from amaranth.hdl import Module, Signal, Value

from kalmanhdl.processor.core import LOOPS
from kalmanhdl.processor.instructions import ARGUMENT_BITS, Opcode


def loop_stack(m: Module, takes_effect: Value, opcode: Value, count: Value) -> Value:
    """Whether the innermost loop is passed once more; LOOP and NEXT move the stack when they take effect."""
    counts = [Signal(ARGUMENT_BITS, name=f"count_{depth}") for depth in range(LOOPS)]
    again = counts[0] != 1
    with m.If(takes_effect), m.Switch(opcode):
        with m.Case(Opcode.LOOP.value):
            m.d.sync += [counts[0].eq(count)]
            m.d.sync += [outer.eq(inner) for inner, outer in pairwise(counts)]
        with m.Case(Opcode.NEXT.value):
            with m.If(again):
                m.d.sync += counts[0].eq(counts[0] - 1)
            with m.Else():
                m.d.sync += [inner.eq(outer) for inner, outer in pairwise(counts)]
    return again
