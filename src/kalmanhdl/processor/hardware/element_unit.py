"""What a core does without the array of multipliers: moves and reciprocals, and fixed-point sums."""

from amaranth.hdl import Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Member, Out

from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.decoding import is_one_of
from kalmanhdl.processor.hardware.function_unit import FunctionUnit
from kalmanhdl.processor.hardware.layouts import is_nonzero, matrix_layout, word_shape
from kalmanhdl.processor.hardware.results import Result
from kalmanhdl.processor.instructions import ARGUMENT_BITS, OPCODE_BITS, Opcode
from kalmanhdl.processor.timing import reciprocal_clocks
from kalmanhdl.rtl.floating.divider import FloatDivider
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal


class ElementUnit(wiring.Component):
    """Takes operands in every clock. The ``result`` stands in the next one, a reciprocal
    ``timing.reciprocal_clocks`` later.

    ``chosen`` is the element of ``a`` that the instruction names; ``incoming`` is what READ gets. ``value``
    is what the ``function`` gives of the operands that came ``function_clocks`` before.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        word, matrix = word_shape(core), matrix_layout(core)
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

    @property
    def result_of_most(self) -> Result:
        """What it finds for all instructions but those of ``results``."""
        return Result(opcodes=(), elements=dict(enumerate(self.result)), outside=self.outside)

    @property
    def results(self) -> tuple[Result, ...]:
        """A reciprocal, which may go to any element, and the value of a function."""
        everywhere = dict.fromkeys(range(self._core.elements), self.reciprocal)
        found = [Result(opcodes=(Opcode.RECIP,), elements=everywhere, outside=self.reciprocal_outside)]
        if self._core.functions:
            found.append(Result(opcodes=(Opcode.FUNC,), elements={0: self.value}, outside=self.value_outside))
        return tuple(found)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = self._core
        matrix = matrix_layout(core)
        a, b = Signal(matrix, reset_less=True), Signal(matrix, reset_less=True)
        opcode, element = Signal(OPCODE_BITS), Signal((core.elements - 1).bit_length())
        incoming = Signal(word_shape(core), reset_less=True)
        m.d.sync += [a.eq(self.a), b.eq(self.b), incoming.eq(self.incoming)]
        m.d.sync += [opcode.eq(self.opcode), element.eq(self.element)]
        with m.Switch(element):
            for number, each in enumerate(a):
                with m.Case(number):
                    m.d.comb += self.chosen.eq(each)
        sums = self._sums(m, opcode, a, b)
        for e in range(core.elements):
            m.d.comb += self.result[e].eq(self._moved(opcode, e, (a, b), incoming, sums[e]))
        if core.extended:
            m.d.comb += self._float_reciprocal(m) if core.floating else self._fixed_reciprocal(m)
        if core.functions:
            m.submodules.functions = unit = FunctionUnit(core)
            m.d.comb += [unit.a.eq(a[0]), unit.b.eq(a[1]), unit.function.eq(self.function)]
            m.d.comb += [self.value.eq(unit.value), self.value_outside.eq(unit.outside)]
        return m

    def _of_functions(self) -> dict[str, Member]:
        """The ports that a core with functions has."""
        if not self._core.functions:
            return {}
        word = word_shape(self._core)
        return {"function": In(ARGUMENT_BITS), "value": Out(word), "value_outside": Out(1)}

    def _sums(self, m: Module, opcode: Value, a: Signal, b: Signal) -> list[Value]:
        """Sums or differences of fixed-point elements; those of floats are the array's."""
        core = self._core
        if core.floating:
            return [Const(0, word_shape(core))] * core.elements
        adds = is_one_of(opcode, core, (Opcode.ADD_33, Opcode.SUB_33))
        subtracts = is_one_of(opcode, core, (Opcode.SUB_33,))
        form, flags = core.fixed_form, Signal(core.elements)
        found = []
        for e in range(core.elements):
            total = Mux(subtracts, a[e] - b[e], a[e] + b[e])
            value, outside = quantised(total, form.fraction, form, core.rounding, core.overflow)
            m.d.comb += flags[e].eq(outside & adds)
            found.append(value)
        m.d.comb += self.outside.eq(flags.any())
        return found

    def _moved(
        self, opcode: Value, element: int, operands: tuple[Signal, Signal], incoming: Value, value: Value
    ) -> Value:
        """An element of the result; ``value`` is that of a sum."""
        core = self._core
        a, b = operands
        row, column = divmod(element, core.size)
        stays = is_nonzero(core, b[row * (core.size + 1)])
        moves = [
            (Opcode.READ, incoming),
            (Opcode.COPY, a[element]),
            (Opcode.TRANS_33, a[core.size * column + row]),
            (Opcode.PLACE, a[0]),
            (Opcode.MASK_33, Mux(stays, a[element], 0)),
        ]
        if element == 0:
            moves.append((Opcode.PICK, self.chosen))
        for each, moved in moves:
            value = Mux(is_one_of(opcode, core, (each,)), moved, value)
        return value

    def _float_reciprocal(self, m: Module) -> list[Value]:
        """1 / the chosen element."""
        form, clocks = self._core.float_form, reciprocal_clocks(self._core)
        m.submodules.reciprocal = unit = FloatDivider(form, clocks, reciprocal=True)
        infinite = unit.result[form.mantissa : -1].all()
        return [unit.b.eq(self.chosen), self.reciprocal.eq(unit.result), self.reciprocal_outside.eq(infinite)]

    def _fixed_reciprocal(self, m: Module) -> list[Value]:
        """Of the chosen element; of what is not positive that of zero."""
        form = self._core.fixed_form
        most = Fixed(width=form.width - 1, fraction=form.fraction, signed=False)
        m.submodules.reciprocal = unit = TableNewtonReciprocal(
            Operand(form=most, low=0, high=most.highest),
            form,
            self._core.rounding,
            self._core.division,
            registers=reciprocal_clocks(self._core),
        )
        return [
            unit.divisor.eq(Mux(self.chosen < 0, 0, self.chosen)),
            self.reciprocal.eq(unit.quotient),
            self.reciprocal_outside.eq(unit.outside),
        ]
