"""Quantisation in hardware is the definition, for every raw integer and every mode."""

from itertools import product

import pytest
from amaranth.hdl import Module, signed, unsigned
from amaranth.lib.wiring import Component, In, Out
from streaming import results

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, quantise
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.shapes import shape_of

FRACTION = 3
FORMS = [
    Fixed(width=width, fraction=fraction, signed=is_signed)
    for width, fraction, is_signed in product((1, 3, 6, 9), (-5, -1, 0, 2, 3, 5), (True, False))
]


class Quantiser(Component):
    registers = 0

    def __init__(self, shape, form, rounding, overflow, bounds=(None, None)) -> None:
        self.form, self.rounding, self.overflow, self.bounds = form, rounding, overflow, bounds
        super().__init__({"raw": In(shape), "value": Out(shape_of(form)), "outside": Out(1)})

    def compute(self, raw: int) -> tuple[int, bool]:
        return quantise(raw, FRACTION, self.form, self.rounding, self.overflow)

    def elaborate(self, platform):
        m = Module()
        modes = (FRACTION, self.form, self.rounding, self.overflow)
        value, outside = quantised(self.raw, *modes, *self.bounds)
        assert value.shape() == shape_of(self.form)
        m.d.comb += [self.value.eq(value), self.outside.eq(outside)]
        return m


def check(cores: list[Quantiser], raws: range) -> None:
    stimuli = [{"raw": raw} for raw in raws]
    for core, values in zip(cores, results(cores, stimuli, ("value", "outside")), strict=True):
        assert values == [core.compute(raw) for raw in raws], (core.form, core.rounding, core.overflow)


@pytest.mark.parametrize("rounding", Rounding)
def test_every_signed_number_becomes_the_defined_one(rounding):
    cores = [Quantiser(signed(7), form, rounding, overflow) for form in FORMS for overflow in Overflow]
    check(cores, range(-64, 64))


@pytest.mark.parametrize("rounding", Rounding)
def test_every_unsigned_number_becomes_the_defined_one(rounding):
    cores = [Quantiser(unsigned(6), form, rounding, overflow) for form in FORMS for overflow in Overflow]
    check(cores, range(64))


@pytest.mark.parametrize("rounding", Rounding)
def test_a_known_interval_leaves_the_numbers_inside_it_as_they_are(rounding):
    cores = [Quantiser(signed(7), form, rounding, Overflow.SATURATE, (-20, 11)) for form in FORMS]
    check(cores, range(-20, 12))
