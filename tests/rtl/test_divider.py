"""The long divider is the definition of a quotient, whatever its radix, interval and registers."""

import pytest
from streaming import results

from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.divider import LongDivider

FORMS = (
    Fixed(width=6, fraction=2, signed=False),
    Fixed(width=6, fraction=2),
    Fixed(width=9, fraction=7),
    Fixed(width=3, fraction=-1),
    Fixed(width=1, fraction=0),
)


def unsigned_operand(width: int, fraction: int, low: int, high: int) -> Operand:
    return Operand(form=Fixed(width=width, fraction=fraction, signed=False), low=low, high=high)


@pytest.mark.parametrize("registers", [0, 3])
@pytest.mark.parametrize("rounding", Rounding)
def test_every_small_quotient_is_the_defined_one(rounding, registers):
    dividend = Operand(form=Fixed(width=5, fraction=1), low=-16, high=15)
    divisor = unsigned_operand(5, 2, 0, 31)
    cores = [
        LongDivider(dividend, divisor, form, rounding, radix, registers) for form in FORMS for radix in (2, 4)
    ]
    stimuli = [{"dividend": a, "divisor": b} for a in range(-16, 16) for b in range(32)]
    for core, values in zip(cores, results(cores, stimuli, ("quotient", "outside")), strict=True):
        for stimulus, value in zip(stimuli, values, strict=True):
            assert value == core.compute(**stimulus), (core.form, core.structure, stimulus)
