"""Rounding and saturation in hardware, proven for every input against what they mean."""

from itertools import product

import pytest
from amaranth.hdl import Assert, Assume, Module, Mux, Signal, signed
from amaranth.lib.wiring import Component, In
from harness import proof

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.shapes import shape_of

WIDTH = 24
FRACTION = 11
FORMS = (
    Fixed(width=9, fraction=7),
    Fixed(width=9, fraction=0, signed=False),
    Fixed(width=20, fraction=11),
    Fixed(width=1, fraction=4, signed=False),
)


def is_rounded(value, raw, dropped, rounding):
    """Whether an integer is a raw integer over 2**dropped, rounded: by how far the two are apart."""
    above = (value << dropped) - raw if dropped else value - raw
    if not dropped:
        return above == 0
    whole, half = 1 << dropped, 1 << (dropped - 1)
    match rounding:
        case Rounding.FLOOR:
            return (above <= 0) & (above > -whole)
        case Rounding.HALF_UP:
            return (above <= half) & (above > -half)
        case Rounding.HALF_EVEN:
            return (above <= half) & (above >= -half) & (((above != half) & (above != -half)) | ~value[0])
        case Rounding.TOWARD_ZERO:
            return Mux(raw < 0, (above >= 0) & (above < whole), (above <= 0) & (above > -whole))


class Quantisations(Component):
    """Numbers of 24 bits, signed or not, brought into every format, against any integer that rounds them.

    ``fault`` changes bits of the number that the hardware sees.
    """

    def __init__(self, rounding: Rounding, fault: int = 0) -> None:
        self.rounding, self.fault = rounding, fault
        ports = {"signed": In(signed(WIDTH)), "unsigned": In(WIDTH)}
        self.cases = list(product(ports, range(len(FORMS))))
        ports |= {f"{raw}_{k}": In(signed(WIDTH + 2)) for raw, k in self.cases}
        super().__init__(ports)

    def elaborate(self, platform):
        m = Module()
        for name, index in self.cases:
            self._case(m, getattr(self, name), getattr(self, f"{name}_{index}"), FORMS[index])
        return m

    def _case(self, m, raw, exact, form):
        m.d.comb += Assume(is_rounded(exact, raw, FRACTION - form.fraction, self.rounding))
        leaves = (exact > form.highest) | (exact < form.lowest)
        low = Signal(shape_of(form))
        m.d.comb += low.eq(exact)
        wanted = {
            Overflow.SATURATE: Mux(leaves, Mux(exact < 0, form.lowest, form.highest), exact),
            Overflow.WRAP: low,
        }
        for overflow, number in wanted.items():
            seen = (raw ^ self.fault).as_signed() if raw.shape().signed else raw ^ self.fault
            value, outside = quantised(seen, FRACTION, form, self.rounding, overflow)
            m.d.comb += [Assert(value == number), Assert(outside == leaves)]


@pytest.mark.parametrize("rounding", Rounding)
def test_a_quantised_number_is_the_rounded_one_brought_into_the_format(rounding):
    found = proof(Quantisations(rounding))
    assert found.bounded, found.broken


def test_a_fault_in_the_quantiser_is_seen():
    assert "Assert failed" in proof(Quantisations(Rounding.FLOOR, fault=1 << 13)).broken
