"""Constant multiplication as shifts and adds."""

from collections.abc import Sequence
from fractions import Fraction

from kalmanhdl.graph.builder import Builder


def canonical_signed_digits(value: int) -> list[tuple[int, int]]:
    """The canonical signed digit form of an integer: (sign, exponent), from the least exponent up.

    No two digits that are not zero stand side by side, so there are as few as can be.
    """
    digits, exponent = [], 0
    while value:
        if value & 1:
            sign = 2 - (value & 3)
            digits.append((sign, exponent))
            value -= sign
        value >>= 1
        exponent += 1
    return digits


FEW_DIGITS = 4
"""A multiplication by so few digits costs less in logic than the way to a multiplier."""


def multiplied(builder: Builder, factor: Fraction, index: int, *, on_multipliers: bool = False) -> int:
    """A binary fraction times a value, as a balanced tree over shifted copies of the value.

    ``on_multipliers``: one of more than a few digits stays a multiplication.
    """
    negative, exponent = factor < 0, factor.denominator.bit_length() - 1
    digits = canonical_signed_digits(abs(factor.numerator))
    if on_multipliers and len(digits) > FEW_DIGITS:
        return builder.multiply(builder.constant(factor), index)
    total = _total(builder, [(sign, builder.shift(index, place - exponent)) for sign, place in digits])
    return builder.negate(total) if negative else total


def _total(builder: Builder, terms: Sequence[tuple[int, int]]) -> int:
    """A balanced tree over signed terms, of which the last is positive."""
    while len(terms) > 1:
        pairs = [terms[k : k + 2] for k in range(0, len(terms), 2)]
        terms = [_pair(builder, *pair) if len(pair) == 2 else pair[0] for pair in pairs]
    sign, index = terms[0]
    return index if sign > 0 else builder.negate(index)


def _pair(builder: Builder, a: tuple[int, int], b: tuple[int, int]) -> tuple[int, int]:
    (p, x), (q, y) = a, b
    if p == q:
        return p, builder.add(x, y)
    return 1, builder.subtract(x, y) if p > 0 else builder.subtract(y, x)
