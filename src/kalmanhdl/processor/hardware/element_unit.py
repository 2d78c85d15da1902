"""What a pipelined core does without the array of multipliers: sums, moves and reciprocals."""

from amaranth.hdl import Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Member, Out

from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.hardware.function_unit import FunctionUnit
from kalmanhdl.processor.hardware.layouts import matrix_layout
from kalmanhdl.processor.instructions import ARGUMENT_BITS, OPCODE_BITS, Opcode
from kalmanhdl.processor.timing import RECIPROCAL_REGISTERS
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal


class ElementUnit(wiring.Component):
    """Takes operands in every clock. The ``result`` stands in the next one, a reciprocal four clocks later.

    ``chosen`` is the element of ``a`` that the instruction names; ``incoming`` is what READ gets. ``value``
    is what the ``function`` gives of the operands that came ``function_clocks`` before.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        word, matrix = signed(core.form.width), matrix_layout(core)
        super().__init__(
            {
                "opcode": In(OPCODE_BITS),
                "element": In(ARGUMENT_BITS),
                "a": In(matrix),
                "b": In(matrix),
                "incoming": In(word),
                "chosen": Out(word),
                "result": Out(matrix),
                "outside": Out(1),
                "reciprocal": Out(word),
                "reciprocal_outside": Out(1),
                **self._of_functions(),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = self._core
        matrix = matrix_layout(core)
        a, b = Signal(matrix, reset_less=True), Signal(matrix, reset_less=True)
        opcode, element = Signal(OPCODE_BITS), Signal((core.elements - 1).bit_length())
        incoming = Signal(signed(core.form.width), reset_less=True)
        m.d.sync += [a.eq(self.a), b.eq(self.b), incoming.eq(self.incoming)]
        m.d.sync += [opcode.eq(self.opcode), element.eq(self.element)]
        with m.Switch(element):
            for number, each in enumerate(a):
                with m.Case(number):
                    m.d.comb += self.chosen.eq(each)
        adds = is_one_of(opcode, core, (Opcode.ADD_33, Opcode.SUB_33))
        subtracts = is_one_of(opcode, core, (Opcode.SUB_33,))
        flags = Signal(core.elements)
        for e in range(core.elements):
            total = Mux(subtracts, a[e] - b[e], a[e] + b[e])
            value, outside = quantised(total, core.form.fraction, core.form, core.rounding, core.overflow)
            m.d.comb += flags[e].eq(outside & adds)
            m.d.comb += self.result[e].eq(self._moved(opcode, e, (a, b), incoming, value))
        m.d.comb += self.outside.eq(flags.any())
        if core.extended:
            self._reciprocal(m)
        if core.functions:
            m.submodules.functions = unit = FunctionUnit(core)
            m.d.comb += [unit.a.eq(a[0]), unit.b.eq(a[1]), unit.function.eq(self.function)]
            m.d.comb += [self.value.eq(unit.value), self.value_outside.eq(unit.outside)]
        return m

    def _of_functions(self) -> dict[str, Member]:
        """The ports that a core with functions has."""
        if not self._core.functions:
            return {}
        word = signed(self._core.form.width)
        return {"function": In(ARGUMENT_BITS), "value": Out(word), "value_outside": Out(1)}

    def _moved(
        self, opcode: Value, element: int, operands: tuple[Signal, Signal], incoming: Value, value: Value
    ) -> Value:
        """An element of the result; ``value`` is that of a sum."""
        core = self._core
        a, b = operands
        row, column = divmod(element, core.size)
        moves = [
            (Opcode.READ, incoming),
            (Opcode.COPY, a[element]),
            (Opcode.TRANS_33, a[core.size * column + row]),
            (Opcode.PLACE, a[0]),
            (Opcode.MASK_33, Mux(b[row * (core.size + 1)] != 0, a[element], 0)),
        ]
        if element == 0:
            moves.append((Opcode.PICK, self.chosen))
        for each, moved in moves:
            value = Mux(is_one_of(opcode, core, (each,)), moved, value)
        return value

    def _reciprocal(self, m: Module) -> None:
        """Of the chosen element; of what is not positive that of zero."""
        form = self._core.form
        most = Fixed(width=form.width - 1, fraction=form.fraction, signed=False)
        m.submodules.reciprocal = unit = TableNewtonReciprocal(
            Operand(form=most, low=0, high=most.highest),
            form,
            self._core.rounding,
            self._core.division,
            registers=RECIPROCAL_REGISTERS,
        )
        m.d.comb += [
            unit.divisor.eq(Mux(self.chosen < 0, 0, self.chosen)),
            self.reciprocal.eq(unit.quotient),
            self.reciprocal_outside.eq(unit.outside),
        ]
