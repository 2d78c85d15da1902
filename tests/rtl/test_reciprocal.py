"""A reciprocal from a table is the defined one, whatever its interval, its registers and its multipliers."""

import pytest
from streaming import results

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal

FORMS = (
    Fixed(width=10, fraction=4),
    Fixed(width=12, fraction=12, signed=False),
    Fixed(width=14, fraction=9),
    Fixed(width=3, fraction=-1),
)
METHODS = (
    TableNewton(index_bits=6, iterations=0),
    TableNewton(index_bits=3, iterations=1),
    TableNewton(index_bits=2, iterations=2),
)


def divisors(low: int, high: int) -> Operand:
    return Operand(form=Fixed(width=10, fraction=5, signed=False), low=low, high=high)


@pytest.mark.parametrize("registers", [0, 4, 11])
@pytest.mark.parametrize("rounding", Rounding)
def test_every_small_reciprocal_is_the_defined_one(rounding, registers):
    divisor = divisors(0, 1023)
    cores = [
        TableNewtonReciprocal(divisor, form, rounding, method, registers, on_block)
        for form in FORMS
        for method in METHODS
        for on_block in (True, False)[method.iterations == 0 :]
    ]
    stimuli = [{"divisor": b} for b in range(1024)]
    for core, values in zip(cores, results(cores, stimuli, ("quotient", "outside")), strict=True):
        for stimulus, value in zip(stimuli, values, strict=True):
            assert value == core.compute(**stimulus), (core.form, core.method, core.structure, stimulus)


@pytest.mark.parametrize(("low", "high"), [(1, 1), (1, 9), (64, 127), (100, 700), (300, 1023), (1000, 1000)])
def test_an_interval_leaves_the_reciprocals_inside_it_as_they_are(low, high):
    divisor = divisors(low, high)
    cores = [
        TableNewtonReciprocal(divisor, form, Rounding.HALF_EVEN, method)
        for form in FORMS
        for method in METHODS
    ]
    stimuli = [{"divisor": b} for b in range(low, high + 1)]
    for core, values in zip(cores, results(cores, stimuli, ("quotient", "outside")), strict=True):
        for stimulus, value in zip(stimuli, values, strict=True):
            assert value == core.compute(**stimulus), (core.form, core.method, core.structure, stimulus)
