"""The long divider is the definition of a quotient, whatever its radix, its intervals and its registers."""

from fractions import Fraction
from math import floor
from random import Random

import pytest
from streaming import results

from kalmanhdl.arithmetic.division_structure import ONE, Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.divider import LongDivider

FORMS = (
    Fixed(width=6, fraction=2, signed=False),
    Fixed(width=6, fraction=2),
    Fixed(width=9, fraction=7),
    Fixed(width=3, fraction=-1),
    Fixed(width=1, fraction=0),
    Fixed(width=1, fraction=-2, signed=False),
)


def operand(width: int, fraction: int, low: int, high: int) -> Operand:
    return Operand(form=Fixed(width=width, fraction=fraction, signed=low < 0), low=low, high=high)


def check(cores: list[LongDivider], stimuli: list[dict[str, int]]) -> None:
    for core, values in zip(cores, results(cores, stimuli, ("quotient", "outside")), strict=True):
        for stimulus, value in zip(stimuli, values, strict=True):
            expected = core.compute(stimulus.get("dividend", 1), stimulus["divisor"])
            assert value == expected, (core.form, core.rounding, core.structure, stimulus)


@pytest.mark.slow
@pytest.mark.parametrize("registers", [0, 3])
@pytest.mark.parametrize("rounding", Rounding)
def test_every_small_quotient_is_the_defined_one(rounding, registers):
    dividend, divisor = operand(5, 1, -16, 15), operand(5, 2, 0, 31)
    cores = [
        LongDivider(dividend, divisor, form, rounding, radix, registers) for form in FORMS for radix in (2, 4)
    ]
    check(cores, [{"dividend": a, "divisor": b} for a in range(-16, 16) for b in range(32)])


@pytest.mark.slow
@pytest.mark.parametrize("rounding", Rounding)
def test_every_reciprocal_of_ten_bits_is_the_defined_one(rounding):
    random = Random(rounding.value)
    forms = (*FORMS, Fixed(width=16, fraction=11), Fixed(width=12, fraction=5, signed=False))
    cores = [
        LongDivider(ONE, operand(10, 5, 0, 1023), form, rounding, radix, random.choice((0, 2, 7, 20)))
        for form in forms
        for radix in (2, 4)
    ]
    check(cores, [{"divisor": b} for b in range(1024)])


@pytest.mark.parametrize("seed", range(3))
def test_a_known_interval_leaves_the_quotients_inside_it_as_they_are(seed):
    random = Random(seed)
    low, high = sorted(random.randrange(-1000, 1000) for _ in "ab")
    least, greatest = sorted(random.randrange(1 << random.randrange(1, 12)) for _ in "ab")
    dividend = Operand(form=Fixed(width=11, fraction=random.randrange(-3, 9)), low=low, high=high)
    divisor = operand(11, random.randrange(-3, 9), least, greatest)
    cores = [
        LongDivider(dividend, divisor, form, rounding, radix, random.randrange(5))
        for form in random.sample(FORMS, 3)
        for rounding in Rounding
        for radix in (2, 4)
    ]
    stimuli = [{"dividend": a, "divisor": b} for a in (low, high) for b in (least, greatest)]
    stimuli += [
        {"dividend": random.randint(low, high), "divisor": random.randint(least, greatest)}
        for _ in range(200)
    ]
    check(cores, stimuli)


def at_boundaries(core: LongDivider, random: Random, count: int) -> list[dict[str, int]]:
    """Operands whose quotients lie at, just below and just above a number of the format, or between two."""
    a, b = core.dividend_operand, core.divisor_operand
    scale = Fraction(2) ** (b.form.fraction - a.form.fraction + core.form.fraction)
    stimuli = []
    while len(stimuli) < count:
        divisor = random.randrange(1, 1 << random.randrange(1, b.width + 1))
        twice = random.randint(2 * core.form.lowest, 2 * core.form.highest + 1) >> random.randrange(
            core.form.width
        )
        for dividend in (floor(Fraction(twice, 2) * divisor / scale) + k for k in (-1, 0, 1, 2)):
            if a.low <= dividend <= a.high and divisor <= b.high:
                stimuli.append({"dividend": dividend, "divisor": divisor})
    return stimuli


@pytest.mark.parametrize("seed", range(3))
def test_quotients_at_the_boundaries_of_rounding_are_the_defined_ones(seed):
    random = Random(seed)
    width = random.randrange(16, 33)
    half = 1 << (width - 1)
    form = Fixed(width=random.randrange(6, width), fraction=random.randrange(width), signed=seed != 1)
    dividend = operand(width, random.randrange(width), -half, half - 1)
    divisor = operand(width, random.randrange(width), 0, 2 * half - 1)
    cores = [
        LongDivider(dividend, divisor, form, rounding, radix) for rounding in Rounding for radix in (2, 4)
    ]
    check(cores, at_boundaries(cores[0], random, 600))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_wide_quotients_are_the_defined_ones(seed):
    random = Random(seed)
    width = random.randrange(20, 41)
    half = 1 << (width - 1)
    dividend = operand(width, random.randrange(30), -half, half - 1)
    divisor = operand(width, random.randrange(30), 0, 2 * half - 1)
    cores = [
        LongDivider(
            dividend,
            divisor,
            Fixed(
                width=random.randrange(8, 40), fraction=random.randrange(-4, 40), signed=random.random() < 0.7
            ),
            rounding,
            radix,
            random.randrange(30),
        )
        for rounding in Rounding
        for radix in (2, 4)
    ]
    sizes = [(random.randrange(1, width), random.randrange(1, width + 1)) for _ in range(150)]
    stimuli = [
        {"dividend": random.randrange(-(1 << a), 1 << a), "divisor": random.randrange(1 << b)}
        for a, b in sizes
    ]
    check(cores, stimuli)
