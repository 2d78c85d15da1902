"""Arrays of floats are the definition on every element."""

import random

import numpy as np
import pytest

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.float_arrays import doubles, float_arrays, summed
from kalmanhdl.arithmetic.floating import Float

FORMS = (
    Float(8, 23),
    Float(5, 10),
    Float(8, 7),
    Float(4, 3),
    Float(2, 5),
    Float(5, 10, subnormals=False),
    Float(8, 23, subnormals=False),
    Float(7, 24),
    Float(9, 24, subnormals=False),
    Float(5, 10, Rounding.TOWARD_ZERO),
    Float(11, 30),
)
OPERATIONS = ("add", "subtract", "multiply", "divide")


def numbers(form, rng, count):
    """Canonical ones: those near each other, those at the ends, and any."""
    found = []
    for _ in range(count):
        sign, kind = rng.choice((0, form.sign)), rng.random()
        if kind < 0.1:
            raw = rng.choice((0, 1, form.highest, form.infinity, form.nan, 1 << form.mantissa))
        elif kind < 0.2:
            raw = rng.randrange(1 << form.mantissa + 1)
        elif kind < 0.7:
            exponent = form.bias + rng.randint(-2, 2)
            raw = max(0, exponent) % (1 << form.exponent) << form.mantissa | rng.randrange(1 << form.mantissa)
        else:
            raw = rng.getrandbits(form.width - 1)
        found.append(form.canonical(sign | raw))
    return found


@pytest.mark.parametrize("form", FORMS, ids=repr)
@pytest.mark.parametrize("operation", OPERATIONS)
def test_every_element_is_that_of_the_definition(form, operation):
    rng, arrays = random.Random(operation), float_arrays(form)
    a, b = numbers(form, rng, 3000), numbers(form, rng, 3000)
    found = arrays.store(getattr(arrays, operation)(arrays.load(a), arrays.load(b)))
    define = getattr(floating, operation)
    wrong = [(x, y, z) for x, y, z in zip(a, b, found, strict=True) if define(form, x, y) != z]
    assert not wrong


@pytest.mark.parametrize("form", FORMS, ids=repr)
def test_numbers_come_back_as_they_went(form):
    raws = numbers(form, random.Random(1), 2000)
    arrays = float_arrays(form)
    assert arrays.store(arrays.load(raws)) == raws
    expected = [form.double(raw) for raw in raws]
    assert np.array_equal(doubles(form, raws), expected, equal_nan=True)
    assert np.array_equal(np.signbit(doubles(form, raws)), np.signbit(expected))


def test_a_sum_adds_neighbours_first_and_the_odd_one_last():
    form = Float(4, 3)
    rng, arrays = random.Random(2), float_arrays(form)
    a, b, c, d, e = (numbers(form, rng, 200) for _ in range(5))
    found = arrays.store(summed(arrays, np.stack([arrays.load(each) for each in (a, b, c, d, e)], -1)))
    add = floating.add
    for p, q, r, s, t, total in zip(a, b, c, d, e, found, strict=True):
        assert total == add(form, add(form, add(form, p, q), add(form, r, s)), t)
