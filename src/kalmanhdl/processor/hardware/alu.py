"""The arithmetic unit: every element of a result is exact, then rounded and clamped once."""

from amaranth.hdl import Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.data import ArrayLayout
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.hardware.decoding import is_one_of, written
from kalmanhdl.processor.hardware.function_unit import FunctionUnit
from kalmanhdl.processor.hardware.layouts import matrix_layout
from kalmanhdl.processor.hardware.operands import second_operands
from kalmanhdl.processor.instructions import (
    ACCUMULATING,
    ARGUMENT_BITS,
    MINORS,
    OPCODE_BITS,
    SYMMETRIC,
    VECTORS,
    Opcode,
)
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal
from kalmanhdl.rtl.shapes import fitted

# From the third clock of an instruction to the seventh.
_RECIPROCAL_REGISTERS = 4


def register(m: Module, name: str, value: Value) -> Value:
    """A value a clock later. Without a reset, so that it can move into a multiplier block."""
    delayed = Signal(value.shape(), name=name, reset_less=True)
    m.d.sync += delayed.eq(value)
    return delayed


class ProductSums(wiring.Component):
    """All N * N sums of N products each: the exact product of two matrices, two clocks after them.

    In place of a sum its first product alone: of the elements of the two, ``elementwise``, or of those of
    their first rows, ``outer``.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self.width = 2 * core.fixed_form.width + (core.size - 1).bit_length()
        sums = ArrayLayout(signed(self.width), core.elements)
        matrix = matrix_layout(core)
        super().__init__(
            {"a": In(matrix), "b": In(matrix), "elementwise": In(1), "outer": In(1), "sums": Out(sums)}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        n = self._core.size
        for i in range(n):
            for j in range(n):
                products = [self._product(m, i, k, j) for k in range(n)]
                total = sum(products[1:], start=products[0])
                if self._core.extended:
                    total = Mux(self.elementwise | self.outer, products[0], total)
                m.d.comb += self.sums[n * i + j].eq(register(m, f"sum_{i}_{j}", total))
        return m

    def _product(self, m: Module, i: int, k: int, j: int) -> Value:
        n = self._core.size
        left, right = self.a[n * i + k], self.b[n * k + j]
        if self._core.extended and k == 0:
            left = Mux(self.elementwise, self.a[n * i + j], Mux(self.outer, self.a[i], left))
            right = Mux(self.elementwise, self.b[n * i + j], right)
        return register(m, f"product_{i}_{k}_{j}", left * right)


class MatrixSum(wiring.Component):
    """The exact sums of the elements of two matrices, or their differences, a clock after them."""

    def __init__(self, core: Core) -> None:
        self._differences = core.extended
        self.width = core.fixed_form.width + 1
        sums = ArrayLayout(signed(self.width), core.elements)
        super().__init__(
            {"a": In(matrix_layout(core)), "b": In(matrix_layout(core)), "subtract": In(1), "sums": Out(sums)}
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # The operands stand still while an instruction executes: one register is time enough.
        for element, (a, b) in enumerate(zip(self.a, self.b, strict=True)):
            total = Mux(self.subtract, a - b, a + b) if self._differences else a + b
            m.d.comb += self.sums[element].eq(register(m, f"sum_{element}", total))
        return m


class Cofactors(wiring.Component):
    """The exact cofactors of a 3 by 3 matrix, two clocks after it, and its determinant after four.

    A core that is not extended needs the first row's alone.
    """

    def __init__(self, core: Core) -> None:
        self._count = 9 if core.extended else 3
        word = core.fixed_form.width
        cofactors = ArrayLayout(signed(2 * word + 1), self._count)
        super().__init__(
            {
                "a": In(matrix_layout(core)),
                "cofactors": Out(cofactors),
                "determinant": Out(signed(3 * word + 3)),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        for element in range(self._count):
            p, q, r, s = (self.a[k] for k in MINORS[element])
            left = register(m, f"left_{element}", p * q)
            right = register(m, f"right_{element}", r * s)
            m.d.comb += self.cofactors[element].eq(register(m, f"cofactor_{element}", left - right))
        terms = [register(m, f"term_{k}", self.a[k] * self.cofactors[k]) for k in range(3)]
        m.d.comb += self.determinant.eq(register(m, "total", terms[0] + terms[1] + terms[2]))
        return m


class Alu(wiring.Component):
    """The result of an instruction from its operands.

    ``a`` is there from the third clock of the instruction on, ``fetched``, the second source as it comes from
    the store, in the fourth, at whose end ``take_b`` keeps it; from the sixth on it is the destination.
    ``chosen`` is the element of ``a`` that the instruction names. ``result`` stands in the eighth, and
    ``outside``: an element that the instruction writes did not fit.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        super().__init__(
            {
                "opcode": In(OPCODE_BITS),
                "exponent": In(signed(ARGUMENT_BITS)),
                "a": In(matrix_layout(core)),
                "chosen": In(signed(core.fixed_form.width)),
                "fetched": In(matrix_layout(core)),
                "take_b": In(1),
                "result": Out(matrix_layout(core)),
                "outside": Out(1),
            }
        )

    def elaborate(self, platform: object) -> Module:
        m = Module()
        core = self._core
        m.submodules.products = products = ProductSums(core)
        m.submodules.sum = total = MatrixSum(core)
        b = Signal(matrix_layout(core), reset_less=True)
        operands = second_operands(m, core, self.opcode, self.exponent, self.fetched)
        with m.If(self.take_b):
            m.d.sync += [b[e].eq(operand) for e, operand in enumerate(operands)]
        m.d.comb += [products.a.eq(self.a), products.b.eq(b), total.a.eq(self.a), total.b.eq(b)]
        m.d.comb += total.subtract.eq(self._is(Opcode.SUB_33))
        m.d.comb += [
            products.elementwise.eq(self._is(Opcode.HAD_33)),
            products.outer.eq(self._is(Opcode.OUTER_33)),
        ]
        exact = [self._exact(e, products, total) for e in range(core.elements)]
        firsts: list[tuple[Opcode, tuple[Value, Value]]] = []
        reciprocal = self._reciprocal(m) if core.extended else None
        if core.functions:
            firsts.append((Opcode.FUNC, self._function(m)))
        if core.size == 3:
            self._add_cofactors(m, exact, firsts)
        flags = Signal(core.elements)
        for e in range(core.elements):
            value, outside = self._quantised(exact[e], 2)
            for opcode, (special, flag) in firsts if e == 0 else ():
                value, outside = Mux(self._is(opcode), special, value), Mux(self._is(opcode), flag, outside)
            value, outside = self._moved(e, b, value, outside)
            counts = written(core, self.opcode, e)
            if reciprocal is not None:
                is_it = self._is(Opcode.RECIP)
                value, outside = Mux(is_it, reciprocal[0], value), Mux(is_it, reciprocal[1], outside)
                # It goes to any element; its flag is that of the first one.
                counts = counts | is_it if e == 0 else counts
            m.d.comb += self.result[e].eq(
                register(m, f"result_{e}", fitted(value, core.fixed_form.width, True))
            )
            m.d.sync += flags[e].eq(outside & counts)
        m.d.comb += self.outside.eq(flags.any())
        return m

    def _exact(self, element: int, products: ProductSums, total: MatrixSum) -> Value:
        row, column = divmod(element, self._core.size)
        product: Value = products.sums[element]
        if row == 0 and column:
            # A vector comes out as a column and is kept as a row.
            product = Mux(self._is(*VECTORS), products.sums[self._core.size * column], product)
        if self._core.extended:
            product = self._accumulated(element, products, product)
        aligned = total.sums[element].shift_left(self._core.fixed_form.fraction)
        sums = self._is(Opcode.ADD_33)
        if self._core.extended:
            sums = sums | self._is(Opcode.SUB_33)
        return Mux(sums, aligned, product)

    def _accumulated(self, element: int, products: ProductSums, product: Value) -> Value:
        """With the destination, which is what is fetched in the seventh clock."""
        n = self._core.size
        mirror = min(element, element % n * n + element // n)
        symmetric = self._is(*SYMMETRIC)
        if mirror != element:
            product = Mux(symmetric, products.sums[mirror], product)
        kept = Mux(symmetric, self.fetched[mirror], self.fetched[element]).shift_left(
            self._core.fixed_form.fraction
        )
        change = Mux(self._is(Opcode.SYMSUB_33, Opcode.MSUB_31), -product, product)
        return Mux(self._is(*ACCUMULATING), kept + change, product)

    def _add_cofactors(
        self, m: Module, exact: list[Value], firsts: list[tuple[Opcode, tuple[Value, Value]]]
    ) -> None:
        """The instructions that are for matrices of 3 by 3 alone."""
        m.submodules.cofactors = cofactors = Cofactors(self._core)
        m.d.comb += cofactors.a.eq(self.a)
        firsts.append((Opcode.DET_33, self._quantised(cofactors.determinant, 3)))
        if self._core.extended:
            for e in range(9):
                row, column = divmod(e, 3)
                exact[e] = Mux(self._is(Opcode.ADJ_33), cofactors.cofactors[3 * column + row], exact[e])

    def _reciprocal(self, m: Module) -> tuple[Value, Value]:
        """Of the chosen element, there from the third clock on; of what is not positive that of zero."""
        form = self._core.fixed_form
        most = Fixed(width=form.width - 1, fraction=form.fraction, signed=False)
        divisor = Operand(form=most, low=0, high=most.highest)
        m.submodules.reciprocal = unit = TableNewtonReciprocal(
            divisor, form, self._core.rounding, self._core.division, registers=_RECIPROCAL_REGISTERS
        )
        m.d.comb += unit.divisor.eq(Mux(self.chosen < 0, 0, self.chosen))
        return unit.quotient, unit.outside

    def _function(self, m: Module) -> tuple[Value, Value]:
        """Of the first two elements, which stand until the instruction ends."""
        m.submodules.functions = unit = FunctionUnit(self._core)
        m.d.comb += [unit.a.eq(self.a[0]), unit.b.eq(self.a[1]), unit.function.eq(self.exponent)]
        return unit.value, unit.outside

    def _moved(self, element: int, b: Signal, value: Value, outside: Value) -> tuple[Value, Value]:
        """The elements that only move."""
        core = self._core
        if not core.extended:
            return value, outside
        row, column = divmod(element, core.size)
        moves = [
            (Opcode.COPY, self.a[element]),
            (Opcode.TRANS_33, self.a[core.size * column + row]),
            (Opcode.PLACE, self.a[0]),
            (Opcode.MASK_33, Mux(b[row * (core.size + 1)] != 0, self.a[element], 0)),
        ]
        if element == 0:
            moves.append((Opcode.PICK, self.chosen))
        for opcode, moved in moves:
            value = Mux(self._is(opcode), moved, value)
            outside = outside & ~self._is(opcode)
        return value, outside

    def _quantised(self, value: Value, times: int) -> tuple[Value, Value]:
        core = self._core
        return quantised(
            value, times * core.fixed_form.fraction, core.fixed_form, core.rounding, core.overflow
        )

    def _is(self, *opcodes: Opcode) -> Value:
        return is_one_of(self.opcode, self._core, opcodes)
