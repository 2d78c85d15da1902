"""Functions by polynomials between the rows of tables."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import count
from math import cos, factorial, pi, prod

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.numerics.functions.circuit import Circuit
from kalmanhdl.numerics.functions.constants import power_of_two, sine_of_quarter

# Bits below the last one of the result in which coefficients and products are kept.
_GUARD = 3


@dataclass(frozen=True, slots=True)
class Curve:
    """A function on 0 to 1 within 2**-bits, and a bound of its derivatives by their order."""

    value: Callable[[Fraction, int], Fraction]
    derivative: Callable[[int], float]


SINE = Curve(sine_of_quarter, lambda order: (pi / 2) ** order)
POWER = Curve(power_of_two, lambda order: 2 * 0.6932**order)


def interpolated(circuit: Circuit, x: int, curve: Curve, index_bits: int, fraction: int) -> int:
    """A curve of x, from 0 to 1, with so many fraction bits and an error of 1.7 units of the last one.

    The upper bits of x are the number of a segment, the others say where in it: Horner's rule there.
    """
    index_bits = min(index_bits, max(circuit.fraction(x), 0))
    below = circuit.fraction(x) - index_bits
    last = circuit.bounds(x)[1] >= 1
    segment = circuit.shift(circuit.floored(x, index_bits), index_bits)
    degree = _degree(curve, index_bits, fraction) if below > 0 else 0
    tables = _tables(curve, index_bits, last, degree, fraction + _GUARD)
    if degree == 0:
        return circuit.nearest(circuit.row(segment, tables[0]), fraction)
    form = Fixed(width=below, fraction=below + index_bits, signed=False)
    t = circuit.shift(circuit.bits(x, form), index_bits)
    total = circuit.row(segment, tables[-1])
    for rows in tables[-2::-1]:
        product = circuit.floored(circuit.builder.multiply(total, t), fraction + _GUARD)
        total = circuit.add(product, circuit.row(segment, rows))
    return circuit.nearest(total, fraction)


def _degree(curve: Curve, index_bits: int, fraction: int) -> int:
    """The least degree whose error is half a unit of the last bit at most."""
    for degree in count(1):
        order = degree + 1
        error = curve.derivative(order) * _node_bound(degree) / factorial(order)
        if error <= 2.0 ** (order * index_bits - fraction - 1):
            return degree
    raise AssertionError


@lru_cache(maxsize=32)
def _nodes(degree: int) -> tuple[Fraction, ...]:
    """Where a polynomial meets its curve: near the ends of Chebyshev's extremes, both ends among them."""
    return tuple(
        round(Fraction((1 - cos(pi * k / degree)) / 2) * 64) / Fraction(64) for k in range(degree + 1)
    )


def _node_bound(degree: int) -> float:
    places = (k / 512 for k in range(513))
    return 1.01 * max(abs(prod(place - float(node) for node in _nodes(degree))) for place in places)


@lru_cache(maxsize=64)
def _tables(
    curve: Curve, index_bits: int, last: bool, degree: int, fraction: int
) -> tuple[tuple[Fraction, ...], ...]:
    """The coefficients of each power by segment; with ``last`` there is a row for the end itself."""
    count_, bits = 1 << index_bits, fraction + 2 * degree + 8
    rows = []
    for segment in range(count_ + last):
        if segment == count_ or degree == 0:
            rows.append((curve.value(Fraction(segment, count_), bits), *(Fraction(0),) * degree))
            continue
        values = [curve.value((segment + node) / count_, bits) for node in _nodes(degree)]
        # Rounded before slopes are taken, the ends of straight lines meet.
        ends = values if degree > 1 else [_rounded(value, fraction) for value in values]
        rows.append(_monomials(_nodes(degree), ends))
    return tuple(tuple(_rounded(row[power], fraction) for row in rows) for power in range(degree + 1))


def _monomials(nodes: tuple[Fraction, ...], values: list[Fraction]) -> tuple[Fraction, ...]:
    """The coefficients, from the constant up, of the polynomial through points (Newton)."""
    differences = list(values)
    for level in range(1, len(nodes)):
        for k in range(len(nodes) - 1, level - 1, -1):
            differences[k] = (differences[k] - differences[k - 1]) / (nodes[k] - nodes[k - level])
    result = [Fraction(0)] * len(nodes)
    for node, difference in zip(reversed(nodes), reversed(differences), strict=True):
        shifted = [Fraction(0), *result[:-1]]
        result = [up - node * same for up, same in zip(shifted, result, strict=True)]
        result[0] += difference
    return tuple(result)


def _rounded(value: Fraction, fraction: int) -> Fraction:
    return Fraction(round(value * (1 << fraction)), 1 << fraction)
