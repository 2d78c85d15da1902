"""Multipliers give the product, proven for every pair of operands."""

import pytest
from amaranth.hdl import Assert, Module, Shape
from amaranth.lib.wiring import Component, In
from harness import proof

from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.rtl.multiplier import Multiplier


class Products(Component):
    """Multipliers of the same operands against a product; ``fault`` is added to it."""

    def __init__(self, a: Shape, b: Shape, fault: int = 0) -> None:
        self.kinds = [Multiplier(a, b, 0, False, logic) for logic in LogicProduct]
        self.fault = fault
        super().__init__({"a": In(a), "b": In(b)})

    def elaborate(self, platform):
        m = Module()
        for index, core in enumerate(self.kinds):
            m.submodules[f"core_{index}"] = core
            m.d.comb += [core.a.eq(self.a), core.b.eq(self.b)]
            m.d.comb += Assert(core.product == self.a * self.b + self.fault)
        return m


@pytest.mark.parametrize(("a", "b"), [(5, 5), (6, 3), (1, 4)])
def test_every_product_in_logic_is_exact(a, b):
    for a_signed, b_signed in ((True, True), (True, False), (False, True), (False, False)):
        found = proof(Products(Shape(a, a_signed), Shape(b, b_signed)))
        assert found.bounded, found.broken


def test_a_wrong_product_is_seen():
    assert "Assert failed" in proof(Products(Shape(4, True), Shape(4, True), fault=1)).broken
