"""The second operand of a product: whatever it is, it becomes a matrix."""

from amaranth.hdl import Const, Module, Mux, Signal, Value

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.hardware.layouts import word_shape
from kalmanhdl.processor.instructions import SYMMETRIC, VECTORS, Opcode


def second_operands(m: Module, core: Core, opcode: Value, exponent: Value, fetched: Value) -> list[Value]:
    """What the products take of the second source, so that every product is that of two matrices.

    Of a vector, in the first row, the first column; of a number, and of a power of two, the diagonal.
    """
    power = _power(m, core, exponent) if core.extended else Const(0)
    return [_second_operand(core, opcode, power, fetched, element) for element in range(core.elements)]


def _second_operand(core: Core, opcode: Value, power: Value, fetched: Value, element: int) -> Value:
    row, column = divmod(element, core.size)
    on_diagonal = row == column
    scales = is_one_of(opcode, core, (Opcode.MULT_3S,))
    value = Mux(scales, fetched[0] if on_diagonal else Const(0), fetched[element])
    if core.extended:
        transposes = is_one_of(opcode, core, (Opcode.MULT_33T, *SYMMETRIC))
        value = Mux(transposes, fetched[core.size * column + row], value)
        shifts = is_one_of(opcode, core, (Opcode.SCALE,))
        value = Mux(shifts, power if on_diagonal else Const(0), value)
    return Mux(is_one_of(opcode, core, VECTORS), fetched[row], value) if column == 0 else value


def _power(m: Module, core: Core, exponent: Value) -> Value:
    """Two to the power of the exponent, as a number of the format."""
    power = Signal(word_shape(core), name="power")
    with m.Switch(exponent):
        for each in core.exponents:
            with m.Case(each):
                m.d.comb += power.eq(core.numbers.nearest(2.0**each))
    return power
