"""A reciprocal from a table is the defined one, whatever its interval, registers and multipliers."""

from random import Random

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


def check(cores: list[TableNewtonReciprocal], raws: list[int]) -> None:
    stimuli = [{"divisor": raw} for raw in raws]
    for core, values in zip(cores, results(cores, stimuli, ("quotient", "outside")), strict=True):
        for raw, value in zip(raws, values, strict=True):
            assert value == core.compute(raw), (core.form, core.rounding, core.method, core.structure, raw)


@pytest.mark.slow
@pytest.mark.parametrize("rounding", Rounding)
def test_every_reciprocal_of_ten_bits_is_the_defined_one(rounding):
    random = Random(rounding.value)
    cores = [
        TableNewtonReciprocal(divisors(0, 1023), form, rounding, method, registers, random.random() < 0.5)
        for form in FORMS
        for method in METHODS
        for registers in (0, random.randrange(1, 15))
    ]
    check(cores, list(range(1024)))


@pytest.mark.parametrize(("low", "high"), [(1, 1), (1, 9), (64, 127), (100, 700), (300, 1023), (1000, 1000)])
def test_a_known_interval_leaves_the_reciprocals_inside_it_as_they_are(low, high):
    random = Random(low)
    cores = [
        TableNewtonReciprocal(divisors(low, high), form, rounding, method, random.randrange(4))
        for form in FORMS[:3]
        for method in METHODS
        for rounding in (Rounding.HALF_UP, Rounding.FLOOR)
    ]
    check(cores, list(range(low, high + 1)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_wide_reciprocals_are_the_defined_ones(seed):
    random = Random(seed)
    cores, width = [], random.randrange(16, 37)
    form = Fixed(width=width, fraction=random.randrange(30), signed=False)
    operand = Operand(form=form, low=0, high=(1 << width) - 1)
    for rounding in Rounding:
        out = Fixed(width=random.randrange(8, 30), fraction=random.randrange(30))
        method = TableNewton(index_bits=random.randrange(1, 9), iterations=random.randrange(3))
        depth, on_block = random.randrange(12), random.random() < 0.5
        cores.append(TableNewtonReciprocal(operand, out, rounding, method, depth, on_block))
    check(cores, [random.randrange(1 << random.randrange(1, width + 1)) for _ in range(400)])
