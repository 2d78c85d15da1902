"""What is built for a division follows from what is known about its operands."""

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.division_structure import ONE, Operand, long_structure, table_structure
from kalmanhdl.arithmetic.fixed import Fixed, Rounding

DIVISOR = Operand(form=Fixed(width=16, fraction=0), low=1 << 12, high=(1 << 15) - 1)
FORM = Fixed(width=16, fraction=20)


def test_a_long_division_has_only_the_rows_that_its_intervals_leave():
    structure = long_structure(ONE, DIVISOR, FORM, Rounding.FLOOR, 2)
    assert structure.rows == 9
    assert structure.row_width == 16
    assert not any((structure.biased, structure.ties, structure.above, structure.below))


def test_radix_four_finds_two_bits_a_row():
    assert long_structure(ONE, DIVISOR, FORM, Rounding.FLOOR, 4).row_bits == (1, 2, 2, 2, 2)


def test_a_divisor_that_can_be_zero_is_checked():
    divisor = Operand(form=DIVISOR.form, low=0, high=DIVISOR.high)
    assert long_structure(ONE, divisor, FORM, Rounding.FLOOR, 2).above


def test_a_table_has_only_the_shifts_that_the_interval_leaves():
    structure = table_structure(DIVISOR, FORM, Rounding.FLOOR, TableNewton(index_bits=6, iterations=0))
    assert structure.positions == 3
    assert not structure.above


def test_divisors_that_always_saturate_need_no_shift():
    divisor = Operand(form=DIVISOR.form, low=0, high=DIVISOR.high)
    structure = table_structure(divisor, FORM, Rounding.FLOOR, TableNewton(index_bits=6, iterations=0))
    # 2**20 / divisor fits 15 bits from a divisor of 33 on, which has 6 bits.
    assert structure.shortest == 6
    assert structure.above
