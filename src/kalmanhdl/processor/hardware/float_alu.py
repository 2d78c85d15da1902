"""The arithmetic unit of floating-point numbers, for instructions that do not overlap."""

from amaranth.hdl import Module, Signal, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.hardware.element_unit import ElementUnit
from kalmanhdl.processor.hardware.float_array import FloatArray
from kalmanhdl.processor.hardware.layouts import matrix_layout
from kalmanhdl.processor.hardware.operands import second_operands
from kalmanhdl.processor.hardware.results import chosen_results
from kalmanhdl.processor.instructions import ARGUMENT_BITS, OPCODE_BITS, Opcode
from kalmanhdl.processor.timing import uses_array


class FloatAlu(wiring.Component):
    """The result of an instruction from its operands, on the units of a pipelined core.

    ``a`` is there from the third clock of the instruction on, ``fetched``, the second source as it comes from
    the store, in the fourth, at whose end ``take_b`` keeps it, and the destination in the sixth, with
    ``start``. ``result`` and ``outside``, an element is not finite, stand as many clocks later as ``timing``
    says, until the instruction ends.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        matrix = matrix_layout(core)
        super().__init__(
            {
                "opcode": In(OPCODE_BITS),
                "exponent": In(signed(ARGUMENT_BITS)),
                "a": In(matrix),
                "fetched": In(matrix),
                "take_b": In(1),
                "start": In(1),
                "result": Out(matrix),
                "outside": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = self._core
        m.submodules.product_array = array = FloatArray(core)
        m.submodules.element_unit = unit = ElementUnit(core)
        b = Signal(matrix_layout(core), reset_less=True)
        operands = second_operands(m, core, self.opcode, self.exponent, self.fetched)
        with m.If(self.take_b):
            m.d.sync += [b[e].eq(operand) for e, operand in enumerate(operands)]
        of_array = is_one_of(self.opcode, core, [each for each in Opcode if uses_array(each, core)])
        m.d.comb += [
            array.start.eq(self.start & of_array),
            array.opcode.eq(self.opcode),
            array.a.eq(self.a),
            array.b.eq(b),
            array.c.eq(self.fetched),
            unit.opcode.eq(self.opcode),
            unit.element.eq(self.exponent),
            unit.a.eq(self.a),
            unit.b.eq(b),
        ]
        if core.functions:
            m.d.comb += unit.function.eq(self.exponent)
        results = (*array.results, *unit.results)
        values, outside = chosen_results(core, self.opcode, unit.result_of_most, results)
        m.d.comb += [self.result[e].eq(value) for e, value in enumerate(values)]
        m.d.comb += self.outside.eq(outside)
        return m
