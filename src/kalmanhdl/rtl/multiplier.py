"""Exact products, on multiplier blocks or from logic."""

from collections.abc import Sequence

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Value, signed, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.product_structure import (
    LogicProduct,
    booth_rows,
    limb_widths,
    recodes_first,
    tree_levels,
    wallace_levels,
)
from kalmanhdl.rtl.adder_tree import Term, joined_terms, summed
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import Stages, named
from kalmanhdl.rtl.wallace import bit_products, carry_saved

# In levels of adders.
_BLOCK_WEIGHT = 2.0
_RECODING_WEIGHT = 0.5
_CARRY_SAVE_WEIGHT = 0.5


class Multiplier(wiring.Component):
    """The product ``a * b``, ``registers`` clocks after its operands.

    ``on_block``: one multiplier block for each pair of limbs (``product_structure.limb_widths``), then
    a tree of adders. Otherwise no block is ever inferred: ``BOOTH`` has the radix-4 Booth rows of the
    shorter operand (``product_structure.booth_terms``), then a tree of adders; ``WALLACE`` the products of
    single bits, levels of carry-save adders, and one adder.
    """

    def __init__(
        self,
        a: Shape,
        b: Shape,
        registers: int = 0,
        on_block: bool = True,
        logic: LogicProduct = LogicProduct.BOOTH,
    ) -> None:
        self.registers, self.on_block, self.logic = registers, on_block, logic
        shape = signed if a.signed or b.signed else unsigned
        super().__init__({"a": In(a), "b": In(b), "product": Out(shape(a.width + b.width))})

    def compute(self, a: int, b: int) -> int:
        """The product of raw integers."""
        return a * b

    def elaborate(self, platform: object) -> Module:
        m = Module()
        if self.on_block:
            self._sum(m, block_products(m, "product", self.a, self.b), _BLOCK_WEIGHT)
        elif self.logic is LogicProduct.BOOTH:
            self._sum(m, logic_products(m, "product", self.a, self.b), _RECODING_WEIGHT)
        else:
            self._sum(m, bit_products(m, "product", self.a, self.b), _RECODING_WEIGHT)
        return m

    def _sum(self, m: Module, terms: list[Term], first: float) -> None:
        """The sum of the terms, which take ``first`` levels of adders to be made."""
        saves = wallace_levels(len(terms)) if self._saves_carries else 0
        levels = 1 if saves else tree_levels(len(terms))
        stages = Stages(m, (first, *(_CARRY_SAVE_WEIGHT,) * saves, *(1.0,) * levels), self.registers)
        if saves:
            terms = carry_saved(m, stages, 1, terms, len(self.product))
        total, _ = summed(m, stages, 1 + saves, terms, len(self.product), {})
        m.d.comb += self.product.eq(stages.before(1 + saves + levels, {"total": total})["total"])

    @property
    def _saves_carries(self) -> bool:
        return not self.on_block and self.logic is LogicProduct.WALLACE


def block_products(m: Module, name: str, a: Value, b: Value) -> list[Term]:
    """The products of all limbs of two numbers, each for one multiplier block."""
    terms = [
        Term(i + j, named(m, f"{name}_{i}_{j}", x * y))
        for i, x in _limbs(a, b.shape().signed)
        for j, y in _limbs(b, a.shape().signed)
    ]
    return joined_terms(terms)


def _limbs(value: Value, other_signed: bool) -> list[tuple[int, Value]]:
    is_signed = value.shape().signed
    limbs: list[tuple[int, Value]] = []
    offset = 0
    for width in limb_widths(len(value), is_signed, other_signed):
        limb = value[offset : offset + width]
        top = offset + width == len(value)
        limbs.append((offset, limb.as_signed() if is_signed and top else limb))
        offset += width
    return limbs


def logic_products(m: Module, name: str, a: Value, b: Value) -> list[Term]:
    """The radix-4 Booth rows of a product.

    A row of a negative digit is the complement of the multiple; the one that it lacks stands in the two
    free positions below the next row.
    """
    x, y = a.shape(), b.shape()
    if recodes_first(x.width, x.signed, y.width, y.signed):
        a, b = b, a
    rows = booth_rows(len(b), b.shape().signed)
    bits = Cat(Const(0, 1), fitted(b, 2 * rows, False))
    terms: list[Term] = []
    missing: Sequence[Value] = ()
    for index in range(rows):
        digit = bits[2 * index : 2 * index + 3]
        row = named(m, f"{name}_row_{index}", booth_row(a, digit))
        offset = 2 * index - (2 if missing else 0)
        terms.append(Term(offset, Cat(*missing, row).as_signed()))
        missing = (digit[2], Const(0, 1))
    if b.shape().signed:
        terms.append(Term(2 * (rows - 1), missing[0]))
    return terms


def booth_row(a: Value, digit: Value) -> Value:
    """A multiple of a: the digit of three overlapping bits times a, less one if the top bit is set."""
    width = len(a) + 1 + (not a.shape().signed)
    once, twice = fitted(a, width, False), fitted(a.shift_left(1), width, False)
    magnitude = Mux(digit[0] ^ digit[1], once, Mux(digit[1] ^ digit[2], twice, 0))
    return (magnitude ^ digit[2].replicate(width))[:width].as_signed()
