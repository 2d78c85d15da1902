"""How products are cut into limbs, and how few addends are left."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.arithmetic.product_structure import block_addends, booth_rows, limb_widths


@given(st.integers(1, 80), st.booleans(), st.booleans())
def test_limbs_hold_the_number_and_fit_a_block(width, is_signed, other_signed):
    limbs = limb_widths(width, is_signed, other_signed)
    assert sum(limbs) == width
    assert min(limbs) > 0
    assert all(limb + ((is_signed or other_signed) and limb is not limbs[-1]) <= 18 for limb in limbs)


@pytest.mark.parametrize(
    ("width", "is_signed", "count"),
    [(18, True, 1), (19, True, 2), (35, True, 2), (36, True, 3), (18, False, 1)],
)
def test_there_are_as_few_limbs_as_can_be(width, is_signed, count):
    assert len(limb_widths(width, is_signed, is_signed)) == count


def test_outer_products_of_two_limbs_are_one_addend():
    assert block_addends(30, True, 30, True) == 3


def test_booth_recoding_halves_the_rows():
    assert (booth_rows(16, True), booth_rows(16, False)) == (8, 9)
