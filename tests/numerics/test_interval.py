"""The bounds of reciprocals, against every divisor."""

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton, reciprocal
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.numerics.interval import reciprocal_interval
from kalmanhdl.numerics.typed import Interval

_WIDTH = 9


@st.composite
def _methods(draw: st.DrawFn) -> DivisionMethod:
    if draw(st.booleans()):
        return LongDivision()
    return TableNewton(index_bits=draw(st.integers(1, 7)), iterations=draw(st.integers(0, 2)))


@given(
    method=_methods(),
    ends=st.tuples(st.integers(0, 2**_WIDTH - 1), st.integers(1, 2**_WIDTH - 1)),
    fraction=st.integers(-3, 12),
    form=st.builds(Fixed, width=st.integers(1, 14), fraction=st.integers(-4, 16), signed=st.just(False)),
    rounding=st.sampled_from(Rounding),
)
@settings(max_examples=150, deadline=None)
def test_a_reciprocal_lies_within_the_bounds_of_its_divisors(
    method: DivisionMethod, ends: tuple[int, int], fraction: int, form: Fixed, rounding: Rounding
) -> None:
    low, high = min(ends), max(ends)
    divisor = Fixed(width=_WIDTH, fraction=fraction, signed=False), Interval(low=low, high=high)
    bounds = reciprocal_interval(divisor, form, rounding, method)
    found = [reciprocal(raw, fraction, form, rounding, method)[0] for raw in range(low, high + 1)]
    assert bounds.low <= min(found) <= max(found) <= bounds.high
    if not (isinstance(method, TableNewton) and method.iterations):
        assert (bounds.low, bounds.high) == (min(found), max(found))


@pytest.mark.parametrize("index_bits", range(1, 9))
def test_one_less_the_reciprocal_of_no_less_than_one_is_never_negative(index_bits: int) -> None:
    """The gain of a measured state is 1 - R / S, S >= R: without a sign there is nothing to saturate."""
    unit, form = Fixed(width=16, fraction=9, signed=False), Fixed(width=16, fraction=15, signed=False)
    divisor = unit, Interval(low=1 << 9, high=unit.highest)
    method = TableNewton(index_bits=index_bits, iterations=0)
    assert reciprocal_interval(divisor, form, Rounding.FLOOR, method).high <= 1 << 15
