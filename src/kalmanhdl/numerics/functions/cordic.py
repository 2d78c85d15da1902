"""CORDIC: rotations by angles whose tangents are powers of two, made of shifts and adds (Volder 1959).

Angles are in turns. Every rotation cuts what it adds; bits below the last one of the result hold what that
may sum up to.
"""

from dataclasses import dataclass
from fractions import Fraction

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.numerics.functions.circuit import Circuit
from kalmanhdl.numerics.functions.constants import arctangent, shrinkage
from kalmanhdl.numerics.functions.square_root import root_above

_ONE, _HALF, _QUARTER = Fraction(1), Fraction(1, 2), Fraction(1, 4)


def rotated(circuit: Circuit, angle: int, fraction: int) -> tuple[int, int]:
    """Cosine and sine of an angle from -1/2 to 1/2, with errors of 1.9 units of their last bit.

    Beyond a quarter of a turn the rotation begins at the opposite point.
    """
    iterations = fraction + 2
    inner = fraction + iterations.bit_length() + 2
    turn = Fixed(width=inner, fraction=inner)
    opposite = circuit.bits(circuit.add(angle, circuit.constant(_QUARTER)), turn)
    length = _nearest(shrinkage(iterations, inner + 2), inner)
    x = circuit.where_negative(opposite, circuit.constant(-length), circuit.constant(length))
    y = circuit.constant(0)
    z = circuit.bits(angle, Fixed(width=inner - 1, fraction=inner))
    form = Fixed(width=inner + 2, fraction=inner)
    for k in range(iterations):
        step = circuit.constant(_nearest(arctangent(k, inner + 2), inner))
        dx, dy = (circuit.floored(circuit.shift(each, -k), inner) for each in (y, x))
        x, y, z = (
            circuit.bits(_against(circuit, z, x, dx), form),
            circuit.bits(_along(circuit, z, y, dy), form),
            circuit.within(_against(circuit, z, z, step), -_HALF / (1 << k), _HALF / (1 << k)),
        )
    cosine, sine = circuit.nearest(x, fraction), circuit.nearest(y, fraction)
    # One unit above one at most, since they are less than two off and full units are reached.
    most = 1 + Fraction(1, 1 << fraction)
    return circuit.within(cosine, -most, most), circuit.within(sine, -most, most)


@dataclass(frozen=True, slots=True)
class Vector:
    """A vector, its length from 1/2 to 3/2 but where it is zero, and what made it so.

    (x, y) with x >= 0 is the one given times 2**-exponent and, where each flag of ``doublings`` holds,
    times 2 to the power beside it; ``start`` is the angle to add, of a half turn where it was turned by one.
    ``zero`` is the flag that both are zero.
    """

    x: int
    y: int
    start: int
    exponent: int
    doublings: tuple[tuple[int, int], ...]
    zero: int


def normalised(circuit: Circuit, x: int, y: int) -> Vector:
    """A vector turned into the right half plane and scaled by powers of two."""
    zero = circuit.constant(0)
    start = circuit.where_negative(y, circuit.constant(-_HALF), circuit.constant(_HALF))
    start = circuit.where_negative(x, start, zero)
    exponent = _exponent(max(abs(bound) for each in (x, y) for bound in circuit.bounds(each)))
    x, y = (
        circuit.magnitude(x),
        circuit.where_negative(x, circuit.subtract(zero, y), y),
    )
    x = circuit.within(circuit.shift(x, -exponent), Fraction(0), _ONE)
    y = circuit.within(circuit.shift(y, -exponent), -_ONE, _ONE)
    doublings = []
    bits = max(circuit.fraction(x), circuit.fraction(y), 1)
    for level in reversed(range((bits - 1).bit_length())):
        times = 1 << level
        short = _shorter(circuit, x, y, Fraction(1, 1 << times))
        doublings.append((short, times))
        x, y = (
            circuit.within(circuit.builder.select(short, circuit.shift(each, times), each), least, _ONE)
            for each, least in ((x, Fraction(0)), (y, -_ONE))
        )
    return Vector(x, y, start, exponent, tuple(doublings), _shorter(circuit, x, y, _QUARTER))


def levelled(circuit: Circuit, vector: Vector, iterations: int, inner: int) -> tuple[int, int]:
    """A vector turned onto the axis: its length, grown by 1 / shrinkage, and the angle turned back by.

    With fewer iterations a run is the beginning of a longer one, so that both share their hardware.
    """
    x, y = circuit.floored(vector.x, inner), circuit.floored(vector.y, inner)
    z = circuit.constant(0)
    turn = Fixed(width=inner, fraction=inner)
    for k in range(iterations):
        step = circuit.constant(_nearest(arctangent(k, inner + 2), inner))
        dx, dy = (circuit.floored(circuit.shift(each, -k), inner) for each in (y, x))
        rest = Fraction(3, 1 << k)
        x, y, z = (
            circuit.within(_along(circuit, y, x, dx), Fraction(0), Fraction(3)),
            circuit.within(_against(circuit, y, y, dy), -rest, rest),
            circuit.bits(_along(circuit, y, z, step), turn),
        )
    return x, z


def arctangent_of(circuit: Circuit, y: int, x: int, fraction: int, precision: int) -> int:
    """The angle of (x, y) from -1/2 to 1/2, zero for (0, 0), with an error of 1.5 units of its last bit.

    ``precision``, at least ``fraction``, decides the width inside.
    """
    vector = normalised(circuit, x, y)
    _, z = levelled(circuit, vector, fraction, _inner(precision))
    unit = Fraction(1, 1 << fraction)
    angle = circuit.nearest(circuit.add(vector.start, z), fraction)
    angle = circuit.within(angle, -_HALF - unit, _HALF + unit)
    return circuit.builder.select(vector.zero, circuit.constant(0), angle)


def hypotenuse_of(circuit: Circuit, y: int, x: int, fraction: int, precision: int) -> int:
    """The length of (x, y) with an error of 1.5 units of its last bit.

    ``precision`` is the least number of correct bits of the longest vector.
    """
    vector = normalised(circuit, x, y)
    precision = max(precision, vector.exponent + fraction + 1)
    inner, iterations = _inner(precision), precision // 2 + 2
    grown, _ = levelled(circuit, vector, iterations, inner)
    length = circuit.times(_nearest(shrinkage(iterations, inner + 2), inner), grown)
    length = circuit.within(length, Fraction(0), Fraction(3, 2), inner)
    length = circuit.shift(length, vector.exponent)
    for short, times in vector.doublings:
        halved = circuit.floored(circuit.shift(length, -times), fraction + 4)
        length = circuit.builder.select(short, halved, length)
    ends = (max(map(abs, circuit.bounds(each))) for each in (x, y))
    longest = root_above(sum((end * end for end in ends), Fraction(0)), fraction)
    return circuit.within(
        circuit.nearest(length, fraction), Fraction(0), longest + Fraction(1, 1 << fraction)
    )


def _inner(precision: int) -> int:
    return precision + precision.bit_length() + 1


def _along(circuit: Circuit, sign: int, a: int, b: int) -> int:
    """a + b, or a - b where the sign is below zero."""
    return circuit.where_negative(sign, circuit.subtract(a, b), circuit.add(a, b))


def _against(circuit: Circuit, sign: int, a: int, b: int) -> int:
    """a - b, or a + b where the sign is below zero."""
    return circuit.where_negative(sign, circuit.add(a, b), circuit.subtract(a, b))


def _shorter(circuit: Circuit, x: int, y: int, limit: Fraction) -> int:
    """The flag x < limit and -limit <= y < limit, for x >= 0."""
    builder, bound = circuit.builder, circuit.constant(limit)
    flags = [circuit.negative(circuit.subtract(each, bound)) for each in (x, y)]
    below = circuit.negative(circuit.add(y, bound))
    return builder.both(builder.both(*flags), builder.opposite(below))


def _exponent(value: Fraction) -> int:
    """The least n with value <= 2**n; 0 for zero."""
    n = value.numerator.bit_length() - value.denominator.bit_length()
    return 0 if not value else next(k for k in (n - 1, n, n + 1) if value <= Fraction(2) ** k)


def _nearest(value: Fraction, fraction: int) -> Fraction:
    return Fraction(round(value * (1 << fraction)), 1 << fraction)
