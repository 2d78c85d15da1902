"""The stage behind a unit is the definition of numbers, whatever it is told; so are divider and adder."""

from itertools import product

import numpy as np
import pytest
from amaranth.sim import Simulator

from kalmanhdl.arithmetic.division import TableNewton, divide, reciprocal
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding, quantise
from kalmanhdl.programmable.control import (
    DROPPED_OF_QUOTIENT,
    LOOKED_UP,
    MOST_ADDED,
    MOST_DROPPED,
    QUOTIENT_BITS_PER_CLOCK,
    quotient_bits,
    quotient_clocks,
)
from kalmanhdl.programmable.hardware.divider import PowerDivider
from kalmanhdl.programmable.hardware.reciprocal import TableReciprocal
from kalmanhdl.programmable.hardware.stage import RoundingStage
from kalmanhdl.programmable.hardware.units import Adder
from kalmanhdl.programmable.operations import ROUNDING_CODES, AddFunction, Stage
from kalmanhdl.shape import Shape

SMALL = Shape(operand_width=5, word_width=12)
MODES = list(product(Rounding, Overflow, (True, False)))


def simulated(component, process):
    simulation = Simulator(component)
    simulation.add_clock(1e-6)
    simulation.add_testbench(process)
    simulation.run()


def stages(random, count):
    """Raw integers, at the limits and elsewhere, with stages after which the rounded one is a word."""
    for k in range(count):
        rounding, overflow, signed = MODES[k % len(MODES)]
        dropped = int(random.integers(-MOST_ADDED, MOST_DROPPED, endpoint=True))
        dropped = int(random.integers(-3, 12)) if random.random() < 0.8 else dropped
        bits = 13 if dropped > 0 else 12 + dropped
        low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if bits > 0 else (0, 0)
        raw = int(random.choice([low, high, 0, random.integers(low, high, endpoint=True)]))
        width = int(random.integers(1, 12, endpoint=signed))
        yield raw, Stage(dropped=dropped, width=width, signed=signed, rounding=rounding, overflow=overflow)


def test_every_stage_is_the_definition():
    stage = RoundingStage(13, SMALL)
    stimuli = list(stages(np.random.default_rng(4), 6000))
    found = []

    async def bench(context):
        # One a clock; what a clock of the stage takes comes in that clock.
        for clock in range(len(stimuli) + 3):
            ages = (clock, clock - 1, clock - 2)
            now, second, third = (stimuli[k] if 0 <= k < len(stimuli) else None for k in ages)
            if now:
                context.set(stage.raw, now[0])
                context.set(stage.shift, MOST_DROPPED - now[1].dropped)
            if second:
                context.set(stage.rounding, ROUNDING_CODES[second[1].rounding])
                context.set(stage.width, second[1].width)
                context.set(stage.unsigned, not second[1].signed)
            if third:
                context.set(stage.wrap, third[1].overflow is Overflow.WRAP)
            if clock > 2:
                found[-1] = (context.get(stage.word), found[-1])
            if third:
                found.append(bool(context.get(stage.outside)))
            await context.tick()

    simulated(stage, bench)
    wanted = [stage.compute(raw, each) for raw, each in stimuli]
    assert found == wanted


@pytest.mark.parametrize("rounding", Rounding)
def test_the_reciprocal_of_a_divisor_is_the_definition(rounding):
    shape = Shape(operand_width=7, word_width=24)
    divider = PowerDivider(shape)
    random = np.random.default_rng(5)
    divisors = [1, 2, 3, 126, 127, 0, -1, *random.integers(1, 128, 60).tolist()]
    exponents = [quotient_bits(shape) - 1, 0, *random.integers(0, quotient_bits(shape), 65).tolist()]
    found = []

    async def bench(context):
        for divisor, exponent in zip(divisors, exponents, strict=True):
            context.set(divider.divisor, divisor)
            context.set(divider.clocks, quotient_clocks(exponent))
            context.set(divider.place, exponent % QUOTIENT_BITS_PER_CLOCK)
            context.set(divider.begin, 1)
            await context.tick()
            context.set(divider.begin, 0)
            for _ in range(quotient_clocks(exponent)):
                await context.tick()
            found.append(context.get(divider.word))

    simulated(divider, bench)
    for divisor, exponent, word in zip(divisors, exponents, found, strict=True):
        form = Fixed(width=9, fraction=exponent - 4 - 1, signed=False)
        rounded = quantise(word, form.fraction + DROPPED_OF_QUOTIENT, form, rounding, Overflow.SATURATE)
        # What is divided by 0 is outside of every format, and so is the word.
        assert rounded == divide(1, 0, max(divisor, 0), 4, form, rounding)
        if divisor > 0:
            assert word == divider.compute(divisor, exponent)


@pytest.mark.parametrize("index_bits", [1, 4, 9])
def test_the_reciprocal_of_a_table_is_the_definition(index_bits):
    shape, method = Shape(operand_width=7, word_width=24), TableNewton(index_bits=index_bits, iterations=0)
    table, divisors, found = TableReciprocal(shape, index_bits), list(range(-2, 128)), []

    async def bench(context):
        for clock in range(len(divisors) + LOOKED_UP):
            if clock < len(divisors):
                context.set(table.divisor, divisors[clock])
            if clock >= LOOKED_UP:
                found.append(context.get(table.word))
            await context.tick()

    simulated(table, bench)
    form = Fixed(width=9, fraction=6, signed=False)
    for divisor, word in zip(divisors, found, strict=True):
        fraction = method.table_fraction + shape.operand_width - 3
        rounded = quantise(word, fraction, form, Rounding.HALF_EVEN, Overflow.SATURATE)
        assert rounded == reciprocal(max(divisor, 0), 3, form, Rounding.HALF_EVEN, method)
        assert divisor <= 0 or word == table.compute(divisor)


@pytest.mark.parametrize("function", AddFunction)
def test_an_adder_is_what_its_function_says(function):
    adder = Adder(SMALL)
    random = np.random.default_rng(6)
    low, high = -(1 << 11), (1 << 11) - 1
    stimuli = [(low, high, 0), (high, low, 1), (low, low, 0), *random.integers(low, high, (50, 3)).tolist()]

    async def bench(context):
        context.set(adder.function, function)
        for a, b, c in stimuli:
            for port, value in ((adder.a, a), (adder.b, b), (adder.c, c & 1)):
                context.set(port, value)
            await context.tick()
            assert context.get(adder.raw) == adder.compute(function, a, b, c & 1)

    simulated(adder, bench)
