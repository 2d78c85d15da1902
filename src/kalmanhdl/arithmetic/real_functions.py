"""Functions of reals in double precision, made of operations that every machine rounds alike.

No function of a mathematical library is called but the square root, which is exact: equal operands give
equal bits everywhere, in Python as in ``simulate/functions.h``, which repeats these lines. Angles are in
turns. Errors stay below three units of the last bit.
"""

import math

SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(8, 0, -1))
"""Of t**17 down to t**3 in the sine of t radians."""
COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(9, 0, -1))
"""Of t**18 down to t**2 in the cosine."""
EXPONENTIAL = tuple(1 / math.factorial(k) for k in range(14, -1, -1))
"""Of r**14 down to 1 in the exponential."""
ARCTANGENT = tuple((-1) ** k / (2 * k + 1) for k in range(7, 0, -1))
"""Of d**15 down to d**3 in the arctangent."""
TURN = 6.283185307179586
PER_RADIAN = 0.15915494309189535
LOG2_E = 1.4426950408889634
# The logarithm of two: its products with the exponents of doubles are exact, and what it lacks.
LN2_HIGH, LN2_LOW = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
EIGHTHS = (
    0.0,
    0.01979171208028277,
    0.03898956518868466,
    0.05710012560995407,
    0.07379180882521663,
    0.08890384224467637,
    0.10241638234956672,
    0.11440534768252679,
    0.125,
)
"""The angles whose tangents are 0, 1/8, ..., 1."""
# Beyond it an exponential is infinite, or zero, in any case.
FARTHEST = 800.0


def sine(turns: float) -> float:
    """The sine of an angle."""
    return _of_quarter(turns, 0)


def cosine(turns: float) -> float:
    """The cosine of an angle."""
    return _of_quarter(turns, 1)


def _of_quarter(turns: float, quarters: int) -> float:
    if not math.isfinite(turns):
        return math.nan
    rest = turns - _nearest(turns)
    quarter = _nearest(4 * rest)
    t = (rest - 0.25 * quarter) * TURN
    square = t * t
    which = (int(quarter) + quarters) % 4
    value = 1 + square * _horner(COSINE, square) if which % 2 else t + t * square * _horner(SINE, square)
    return -value if which >= 2 else value


def exponential(x: float) -> float:
    """The natural exponential."""
    if math.isnan(x):
        return x
    x = min(max(x, -FARTHEST), FARTHEST)
    whole = _nearest(x * LOG2_E)
    rest = (x - whole * LN2_HIGH) - whole * LN2_LOW
    first = int(whole) >> 1
    return _horner(EXPONENTIAL, rest) * math.ldexp(1.0, first) * math.ldexp(1.0, int(whole) - first)


def wrap(turns: float) -> float:
    """The angle less whole turns, from -1/2 to below 1/2."""
    if not math.isfinite(turns):
        return math.nan
    rest = turns - _nearest(turns)
    return -0.5 if rest == 0.5 else rest


def arctangent(height: float, right: float) -> float:
    """The angle of a point, from -1/2 to 1/2; zero for the origin."""
    if not (math.isfinite(height) and math.isfinite(right)):
        return math.nan
    low, high = sorted((abs(height), abs(right)))
    if high == 0:
        return 0.0
    slope = low / high
    eighth = _nearest(8 * slope)
    near = 0.125 * eighth
    d = (slope - near) / (1 + slope * near)
    square = d * d
    angle = EIGHTHS[int(eighth)] + (d + d * square * _horner(ARCTANGENT, square)) * PER_RADIAN
    angle = 0.25 - angle if abs(height) > abs(right) else angle
    angle = 0.5 - angle if right < 0 else angle
    return -angle if height < 0 else angle


def hypotenuse(a: float, b: float) -> float:
    """The length of a vector."""
    if not (math.isfinite(a) and math.isfinite(b)):
        return abs(a) + abs(b)
    low, high = sorted((abs(a), abs(b)))
    if high == 0:
        return 0.0
    slope = low / high
    return high * math.sqrt(1 + slope * slope)


def _nearest(x: float) -> float:
    """The nearest integer, ties to even, with the sign of x."""
    return x if abs(x) >= 2.0**52 else math.copysign(float(round(x)), x)


def _horner(coefficients: tuple[float, ...], x: float) -> float:
    total = coefficients[0]
    for coefficient in coefficients[1:]:
        total = total * x + coefficient
    return total
