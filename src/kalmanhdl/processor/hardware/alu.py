"""The arithmetic unit: every element of a result is exact, then rounded and clamped once."""

from amaranth.hdl import Const, Module, Mux, Signal, Value, signed
from amaranth.lib import wiring
from amaranth.lib.data import ArrayLayout
from amaranth.lib.wiring import In, Out

from kalmanhdl.processor.core import Core, writes
from kalmanhdl.processor.hardware.layouts import matrix_layout
from kalmanhdl.processor.instructions import OPCODE_BITS, Opcode
from kalmanhdl.rtl.quantiser import quantised


def register(m: Module, name: str, value: Value) -> Value:
    """A value a clock later. Without a reset, so that it can move into a multiplier block."""
    delayed = Signal(value.shape(), name=name, reset_less=True)
    m.d.sync += delayed.eq(value)
    return delayed


class ProductSums(wiring.Component):
    """All N * N sums of N products each: the exact product of two matrices, two clocks after them."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self.width = 2 * core.form.width + (core.size - 1).bit_length()
        sums = ArrayLayout(signed(self.width), core.elements)
        super().__init__({"a": In(matrix_layout(core)), "b": In(matrix_layout(core)), "sums": Out(sums)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        n = self._core.size
        for i in range(n):
            for j in range(n):
                products = [self._product(m, i, k, j) for k in range(n)]
                total = register(m, f"sum_{i}_{j}", sum(products[1:], start=products[0]))
                m.d.comb += self.sums[n * i + j].eq(total)
        return m

    def _product(self, m: Module, i: int, k: int, j: int) -> Value:
        n = self._core.size
        return register(m, f"product_{i}_{k}_{j}", self.a[n * i + k] * self.b[n * k + j])


class MatrixSum(wiring.Component):
    """The exact sums of the elements of two matrices, two clocks after them."""

    def __init__(self, core: Core) -> None:
        self.width = core.form.width + 1
        sums = ArrayLayout(signed(self.width), core.elements)
        super().__init__({"a": In(matrix_layout(core)), "b": In(matrix_layout(core)), "sums": Out(sums)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        # The operands stand still while an instruction executes: one register is time enough.
        for element, (a, b) in enumerate(zip(self.a, self.b, strict=True)):
            m.d.comb += self.sums[element].eq(register(m, f"sum_{element}", a + b))
        return m


class Determinant(wiring.Component):
    """The exact determinant of a 3 by 3 matrix, four clocks after it."""

    def __init__(self, core: Core) -> None:
        self._word = core.form.width
        self.width = 3 * core.form.width + 3
        super().__init__({"a": In(matrix_layout(core)), "determinant": Out(signed(self.width))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        terms = []
        for row, minor in enumerate(((4, 8, 7, 5), (5, 6, 8, 3), (3, 7, 6, 4))):
            p, q, r, s = (self.a[element] for element in minor)
            left = register(m, f"left_{row}", p * q)
            right = register(m, f"right_{row}", r * s)
            cofactor = register(m, f"cofactor_{row}", left - right)
            terms.append(register(m, f"term_{row}", self.a[row] * cofactor))
        m.d.comb += self.determinant.eq(register(m, "total", terms[0] + terms[1] + terms[2]))
        return m


class Alu(wiring.Component):
    """The result of an instruction from its operands.

    ``a`` is there from the third clock of the instruction on, ``fetched``, the second source as it comes
    from the store, in the fourth, at whose end ``take_b`` keeps it. ``result`` stands in the eighth, and
    ``outside``: an element that the instruction writes did not fit.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        super().__init__(
            {
                "opcode": In(OPCODE_BITS),
                "a": In(matrix_layout(core)),
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
        m.submodules.determinant = determinant = Determinant(core)
        b = Signal(matrix_layout(core), reset_less=True)
        with m.If(self.take_b):
            m.d.sync += [b[e].eq(self._second_operand(e)) for e in range(core.elements)]
        m.d.comb += [products.a.eq(self.a), products.b.eq(b), total.a.eq(self.a), total.b.eq(b)]
        m.d.comb += determinant.a.eq(self.a)
        flags = Signal(core.elements)
        for e in range(core.elements):
            value, outside = self._element(e, products, total)
            if e == 0:
                of_determinant = self._quantised(determinant.determinant, 3)
                chosen = self._is(Opcode.DET_33)
                value = Mux(chosen, of_determinant[0], value)
                outside = Mux(chosen, of_determinant[1], outside)
            m.d.comb += self.result[e].eq(register(m, f"result_{e}", value))
            m.d.sync += flags[e].eq(outside & self._written(e))
        m.d.comb += self.outside.eq(flags.any())
        return m

    def _second_operand(self, element: int) -> Value:
        """What the products take of the second source, so that every product is that of two matrices.

        Of a vector, in the first row, the first column; of a number, the diagonal.
        """
        row, column = divmod(element, self._core.size)
        of_number = self.fetched[0] if row == column else Const(0)
        value = Mux(self._is(Opcode.MULT_3S), of_number, self.fetched[element])
        return Mux(self._is(Opcode.MULT_31), self.fetched[row], value) if column == 0 else value

    def _element(self, element: int, products: ProductSums, total: MatrixSum) -> tuple[Value, Value]:
        row, column = divmod(element, self._core.size)
        product: Value = products.sums[element]
        if row == 0 and column:
            # A vector comes out as a column and is kept as a row.
            product = Mux(self._is(Opcode.MULT_31), products.sums[self._core.size * column], product)
        aligned = total.sums[element].shift_left(self._core.form.fraction)
        return self._quantised(Mux(self._is(Opcode.ADD_33), aligned, product), 2)

    def _quantised(self, value: Value, times: int) -> tuple[Value, Value]:
        core = self._core
        return quantised(value, times * core.form.fraction, core.form, core.rounding, core.overflow)

    def _is(self, opcode: Opcode) -> Value:
        return self.opcode == opcode.value

    def _written(self, element: int) -> Value:
        """Whether the instruction writes an element."""
        return written(self._core, self.opcode, element)


def written(core: Core, opcode: Value, element: int) -> Value:
    """Whether an arithmetic instruction writes an element of its destination."""
    found: Value = Const(0)
    for each in Opcode:
        if element in writes(each, core):
            found = found | (opcode == each.value)
    return found
