"""Exact products, on multiplier blocks or from logic."""

from collections.abc import Sequence

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Value, signed, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from kalmanhdl.arithmetic.product_structure import (
    booth_rows,
    limb_widths,
    recodes_first,
    tree_levels,
)
from kalmanhdl.rtl.adder_tree import Term, joined_terms, summed
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import Stages, named

# In levels of adders.
_BLOCK_WEIGHT = 2.0
_RECODING_WEIGHT = 0.5


class Multiplier(wiring.Component):
    """The product ``a * b``, ``registers`` clocks after its operands.

    ``on_block``: one multiplier block for each pair of limbs (``product_structure.limb_widths``), then
    a tree of adders. Otherwise radix-4 Booth rows of the shorter operand
    (``product_structure.booth_terms``), then a tree of adders: no block is ever inferred.
    """

    def __init__(self, a: Shape, b: Shape, registers: int = 0, on_block: bool = True) -> None:
        self.registers, self.on_block = registers, on_block
        shape = signed if a.signed or b.signed else unsigned
        super().__init__({"a": In(a), "b": In(b), "product": Out(shape(a.width + b.width))})

    def compute(self, a: int, b: int) -> int:
        """The product of raw integers."""
        return a * b

    def elaborate(self, platform: object) -> Module:
        m = Module()
        products = block_products if self.on_block else logic_products
        terms = products(m, "product", self.a, self.b)
        first = _BLOCK_WEIGHT if self.on_block else _RECODING_WEIGHT
        levels = tree_levels(len(terms))
        stages = Stages(m, (first, *(1.0,) * levels), self.registers)
        total, _ = summed(m, stages, 1, terms, len(self.product), {})
        m.d.comb += self.product.eq(stages.before(1 + levels, {"total": total})["total"])
        return m


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
        row = named(m, f"{name}_row_{index}", _booth_row(a, digit))
        offset = 2 * index - (2 if missing else 0)
        terms.append(Term(offset, Cat(*missing, row).as_signed()))
        missing = (digit[2], Const(0, 1))
    if b.shape().signed:
        terms.append(Term(2 * (rows - 1), missing[0]))
    return terms


def _booth_row(a: Value, digit: Value) -> Value:
    """A multiple of a: the digit of three overlapping bits times a, less one if the top bit is set."""
    width = len(a) + 1 + (not a.shape().signed)
    once, twice = fitted(a, width, False), fitted(a.shift_left(1), width, False)
    magnitude = Mux(digit[0] ^ digit[1], once, Mux(digit[1] ^ digit[2], twice, 0))
    return (magnitude ^ digit[2].replicate(width))[:width].as_signed()
