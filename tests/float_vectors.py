"""Operands of floating-point operations that find what goes wrong, after the classes of Berkeley TestFloat.

Exponents at their ends and beside each other, significands of few ones or few zeros, sums that cancel,
results half way between two numbers and a little beside, subnormals, zeros, infinities and NaN.
"""

import numpy as np


def operands(form, count, seed, number=2):
    """So many arrays of encoded numbers, ``count`` each."""
    random = np.random.default_rng(seed)
    first = _numbers(random, form, count)
    others = []
    for _ in range(number - 1):
        other = _numbers(random, form, count)
        kind = random.random(count)
        other = np.where(kind < 0.35, _beside(random, form, first, other), other)
        other = np.where(kind < 0.10, _cancelling(random, form, first), other)
        others.append(other)
    return (first, *others)


def _numbers(random, form, count):
    sign = random.integers(0, 2, count).astype(np.uint64) << np.uint64(form.width - 1)
    bits = (
        sign | _exponents(random, form, count) << np.uint64(form.mantissa) | _fractions(random, form, count)
    )
    special = [0, 1, (1 << form.mantissa) - 1, 1 << form.mantissa, form.highest, form.infinity, form.nan]
    special += [form.nan | 1, form.infinity + 1, form.bias << form.mantissa]
    drawn = random.choice(np.array(special, np.uint64), count) | sign
    return np.where(random.random(count) < 0.05, drawn, bits)


def _exponents(random, form, count):
    top = (1 << form.exponent) - 1
    kind = random.random(count)
    found = random.integers(0, top, count)
    near_one = form.bias + random.integers(-form.mantissa - 3, form.mantissa + 3, count, endpoint=True)
    found = np.where(kind < 0.5, np.clip(near_one, 0, top - 1), found)
    found = np.where(kind < 0.20, random.integers(0, min(3, top), count), found)
    found = np.where(kind < 0.10, top - 1 - random.integers(0, min(3, top), count), found)
    return found.astype(np.uint64)


def _fractions(random, form, count):
    width = form.mantissa
    whole = np.uint64((1 << width) - 1)
    found = random.integers(0, 1 << width, count, dtype=np.uint64)
    place = random.integers(0, width, count, endpoint=True).astype(np.uint64)
    other = random.integers(0, width, count, endpoint=True).astype(np.uint64)
    one = np.uint64(1)
    patterns = [
        one << place,
        (one << place) - one,
        (one << place) - (one << np.minimum(place, other)),
        found >> place << place,
        (one << place) + (one << other),
    ]
    kind = random.integers(0, 2 * len(patterns), count)
    for number, pattern in enumerate(patterns):
        found = np.where(kind == number, pattern & whole, found)
    return np.where(random.random(count) < 0.2, ~found & whole, found)


def _beside(random, form, first, other):
    """Numbers with exponents so near the first one's that their significands overlap, or just do not."""
    top = (1 << form.exponent) - 1
    shift = np.uint64(form.mantissa)
    exponent = (first >> shift & np.uint64(top)).astype(np.int64)
    exponent += random.integers(-form.mantissa - 4, form.mantissa + 4, len(first), endpoint=True)
    placed = np.clip(exponent, 0, top - 1).astype(np.uint64) << shift
    return other & ~(np.uint64(top) << shift) | placed


def _cancelling(random, form, first):
    """The first numbers with the other sign, and a few last bits more or less."""
    mask = np.uint64(form.sign - 1)
    last = random.integers(-3, 3, len(first), endpoint=True)
    magnitude = np.clip((first & mask).astype(np.int64) + last, 0, form.nan)
    return magnitude.astype(np.uint64) | ~first & np.uint64(form.sign)
