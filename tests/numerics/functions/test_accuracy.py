"""Functions in fixed point against 40 digits: how far they are off, where, and at the ends."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from function_graphs import alone, errors, values
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.graph.operations import Bits, Function, Multiply, Table
from kalmanhdl.numerics.functions.method import Cordic, Interpolation, method_for

CORDIC, TABLE = Cordic(), Interpolation(index_bits=6)
METHODS = pytest.mark.parametrize("method", [CORDIC, TABLE])
# Half a last bit by the final rounding, and what the function itself may be off by.
BOUND = 0.5 + 0.3


def s(width: int, fraction: int) -> Fixed:
    return Fixed(width=width, fraction=fraction)


def u(width: int, fraction: int) -> Fixed:
    return Fixed(width=width, fraction=fraction, signed=False)


def everything(*forms: Fixed) -> tuple[np.ndarray, ...]:
    """Every raw integer of a format, or every pair of two."""
    axes = [np.arange(form.lowest, form.highest + 1) for form in forms]
    return tuple(grid.ravel() for grid in np.meshgrid(*axes))


def drawn(count: int, *forms: Fixed) -> tuple[np.ndarray, ...]:
    """Raw integers anywhere in formats, of any magnitude, and at their limits."""
    random = np.random.default_rng(7)
    raws = []
    for form in forms:
        raw = random.integers(form.lowest, form.highest, count, endpoint=True)
        raw[: count // 2] >>= random.integers(0, form.width, count // 2)
        raw[:12] = random.choice([form.lowest, form.highest, 0, 1], 12)
        raws.append(raw)
    return tuple(raws)


CASES = [
    (Function.SINE, (s(12, 10),), s(12, 10)),
    (Function.COSINE, (s(12, 10),), s(12, 10)),
    (Function.SINE, (s(10, 12),), s(12, 10)),
    (Function.COSINE, (s(12, 3),), s(9, 7)),
    (Function.SINE, (s(12, 1),), s(14, 12)),
    (Function.WRAP, (s(12, 9),), s(12, 11)),
    (Function.WRAP, (s(12, -2),), s(12, 11)),
    (Function.SQUARE_ROOT, (u(12, 8),), s(12, 7)),
    (Function.SQUARE_ROOT, (u(12, 3),), s(12, 3)),
    (Function.SQUARE_ROOT, (s(11, 12),), u(10, 11)),
    (Function.SQUARE_ROOT, (u(9, -4),), u(12, 2)),
    (Function.EXPONENTIAL, (s(12, 8),), s(14, 4)),
    (Function.EXPONENTIAL, (s(12, 8),), s(14, 10)),
    (Function.EXPONENTIAL, (s(12, 12),), s(12, 10)),
    (Function.EXPONENTIAL, (s(12, 4),), u(12, 13)),
    (Function.EXPONENTIAL, (u(10, 6),), u(16, 0)),
    (Function.ARCTANGENT, (s(6, 3), s(6, 3)), s(12, 11)),
    (Function.ARCTANGENT, (s(6, 2), s(6, 5)), s(10, 9)),
    (Function.ARCTANGENT, (u(5, 2), s(7, 1)), s(10, 8)),
    (Function.HYPOTENUSE, (s(6, 3), s(6, 3)), s(12, 8)),
    (Function.HYPOTENUSE, (s(5, 1), s(7, 6)), u(10, 5)),
    (Function.HYPOTENUSE, (s(6, 3), s(6, 3)), u(8, 6)),
]


@METHODS
@pytest.mark.parametrize(("function", "arguments", "result"), CASES, ids=str)
def test_every_value_of_short_words_is_within_its_bound(function, arguments, result, method):
    typed = alone(function, arguments, result, method)
    above = errors(function, arguments, result, typed, *everything(*arguments))
    assert np.abs(above).max() <= BOUND


@METHODS
@pytest.mark.parametrize("width", [16, 20, 24, 32])
@pytest.mark.parametrize("function", list(Function))
def test_values_of_long_words_are_within_the_same_bound(function, width, method):
    arguments, result = {
        Function.SINE: ((s(width, width - 3),), s(width, width - 2)),
        Function.COSINE: ((s(width, width - 1),), s(width, width - 2)),
        Function.WRAP: ((s(width, width - 4),), s(width, width - 1)),
        Function.SQUARE_ROOT: ((u(width, width // 2),), u(width, width * 3 // 4)),
        Function.EXPONENTIAL: ((s(width, width - 4),), s(width, width - 13)),
        Function.ARCTANGENT: ((s(width, 3), s(width - 3, 9)), s(width, width - 1)),
        Function.HYPOTENUSE: ((s(width, 3), s(width - 3, 9)), u(width, 2)),
    }[function]
    typed = alone(function, arguments, result, method)
    above = errors(function, arguments, result, typed, *drawn(1500, *arguments))
    assert np.abs(above).max() <= BOUND


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(list(Function)), st.data())
def test_any_formats_keep_the_bound(function, data):
    def form(fraction: int) -> Fixed:
        """A format whose values are neither all tiny nor beyond every result."""
        width = data.draw(st.integers(3, 20))
        return Fixed(width=width, fraction=width - fraction, signed=data.draw(st.booleans()))

    pair = function in (Function.ARCTANGENT, Function.HYPOTENUSE)
    arguments = tuple(form(data.draw(st.integers(-3, 4))) for _ in range(2 if pair else 1))
    result = form(data.draw(st.integers(1, 6)))
    method = data.draw(st.sampled_from([CORDIC, TABLE, Interpolation(index_bits=3), None]))
    typed = alone(function, arguments, result, method)
    above = errors(function, arguments, result, typed, *drawn(150, *arguments))
    assert np.abs(above).max() <= BOUND


def test_square_roots_are_exact_and_rounded_down():
    argument, result = u(12, 5), u(12, 8)
    typed = alone(Function.SQUARE_ROOT, (argument,), result, None, Rounding.FLOOR)
    raws = everything(argument)[0]
    for raw, root in zip(raws, values(typed, raws), strict=True):
        below = int(root * 256)
        assert below**2 << argument.fraction <= int(raw) << 16 < (below + 1) ** 2 << argument.fraction


def test_the_root_of_what_is_below_zero_is_zero():
    argument = s(8, 4)
    typed = alone(Function.SQUARE_ROOT, (argument,), s(8, 4), None)
    assert not any(values(typed, np.arange(-128, 1)))


@METHODS
def test_sines_are_exact_at_every_quarter_of_a_turn_and_odd(method):
    argument = s(12, 9)
    raws = everything(argument)[0]
    sines = values(alone(Function.SINE, (argument,), s(16, 14), method), raws)
    cosines = values(alone(Function.COSINE, (argument,), s(16, 14), method), raws)
    quarters = np.flatnonzero(raws % 128 == 0)
    assert [sines[k] for k in quarters] == [(0, 1, 0, -1)[raws[k] // 128 % 4] for k in quarters]
    assert [cosines[k] for k in quarters] == [(1, 0, -1, 0)[raws[k] // 128 % 4] for k in quarters]


@METHODS
def test_angles_of_the_axes(method):
    argument = s(8, 3)
    typed = alone(Function.ARCTANGENT, (argument, argument), s(16, 15), method)
    y = np.array([0, 0, 0, 127, -128, 1, -1, 0, -128, 127])
    x = np.array([0, 1, 127, 0, 0, 0, 0, -1, -128, -128])
    angles = values(typed, y, x)
    assert angles[:8] == [0, 0, 0, 0.25, -0.25, 0.25, -0.25, 0.5]
    assert angles[8] == -0.375
    assert 0.374 < angles[9] < 0.376


@METHODS
def test_the_longest_vector_fits_and_none_has_no_length(method):
    argument = s(8, 3)
    typed = alone(Function.HYPOTENUSE, (argument, argument), s(16, 10), method)
    none, longest, long = values(typed, np.array([0, -128, -128]), np.array([0, -128, 0]))
    assert (none, long) == (0, 16)
    assert abs(float(longest) - 512**0.5) < 2**-10
    assert not typed.violations


def test_an_exponential_by_straight_lines_never_falls():
    argument = s(12, 9)
    typed = alone(Function.EXPONENTIAL, (argument,), s(16, 7), Interpolation(index_bits=8))
    found = values(typed, everything(argument)[0])
    assert all(a <= b for a, b in pairwise(found))


def test_an_exponential_beyond_its_format_saturates_and_says_so():
    argument, result = s(12, 4), s(10, 4)
    typed = alone(Function.EXPONENTIAL, (argument,), result, None)
    assert len(typed.violations) == 1
    assert values(typed, np.array([2047, -2048])) == [result.real(result.highest), 0]


def test_a_turn_more_is_free():
    typed = alone(Function.WRAP, (s(16, 10),), s(16, 15), None)
    kinds = {type(operation) for operation in typed.graph.operations}
    assert Bits in kinds
    assert not typed.violations


def test_cordic_needs_neither_tables_nor_multiplications():
    for function in (Function.SINE, Function.EXPONENTIAL, Function.HYPOTENUSE):
        arguments = (s(16, 12),) * (2 if function is Function.HYPOTENUSE else 1)
        typed = alone(function, arguments, s(16, 10), CORDIC)
        assert not any(isinstance(operation, Multiply | Table) for operation in typed.graph.operations)


def test_wide_results_choose_cordic_and_short_ones_short_tables():
    assert method_for(16) == Interpolation(index_bits=8)
    assert method_for(9) == Interpolation(index_bits=5)
    assert method_for(40) == Cordic()
