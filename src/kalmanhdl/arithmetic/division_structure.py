"""How large the hardware of a division is, from what is known about its operands.

Cores and schedulers both ask here, so that an estimate speaks of the rows that are built.
"""

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import ceil

from kalmanhdl.arithmetic.division import TableNewton, divide, reciprocal_table
from kalmanhdl.arithmetic.fixed import Fixed, Rounding, rounded

# Wide enough that no quotient of a design reaches its limits.
_UNBOUNDED_BITS = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class Operand:
    """Raw integers of a format, known to lie from ``low`` to ``high``."""

    form: Fixed
    low: int
    high: int

    @property
    def signed(self) -> bool:
        """Whether a negative value is possible."""
        return self.low < 0

    @property
    def width(self) -> int:
        """The bits that hold every value, in two's complement if a negative one is possible."""
        return bits_of(self.low, self.high)


ONE = Operand(form=Fixed(width=1, fraction=0, signed=False), low=1, high=1)


def bits_of(low: int, high: int) -> int:
    """The bits that hold every integer from ``low`` to ``high``, at least one."""
    if low < 0:
        return max((-low - 1).bit_length(), max(high, 0).bit_length()) + 1
    return max(high.bit_length(), 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class LongStructure:
    """A non-restoring long division.

    ``rows`` quotient bits are found one after the other, each by an adder of ``row_width`` bits that
    adds or subtracts the divisor (radix 4: two bits by three adders of that width side by side, then a
    selection). Before the first row stands an adder if ``biased`` (nearest rounding of a dividend that
    is not constant, or rounding of negative quotients toward zero), after the last a comparison with zero
    if ``ties``, then a selection if ``above`` or ``below`` (the quotient can leave the format).
    """

    rows: int
    radix: int
    row_width: int
    negative: bool
    biased: bool
    ties: bool
    above: bool
    below: bool

    @property
    def row_bits(self) -> tuple[int, ...]:
        """The quotient bits that each row of hardware finds, the first row first."""
        if self.radix == 2:
            return (1,) * self.rows
        return (1,) * (self.rows % 2) + (2,) * (self.rows // 2)


def inner(form: Fixed) -> Fixed:
    """The format in which the quotient is found before it is clamped."""
    # Parity decides ties only in a format whose greatest number is odd, which 0 is not.
    if form.highest == 0:
        return Fixed(width=2, fraction=form.fraction)
    return form


def row_weights(structure: LongStructure) -> tuple[float, ...]:
    """The delay of each step in radix-2 rows: what is before the rows, the rows, what is after."""
    before = 1.0 if structure.biased else 0.1
    after = 0.1 + 0.7 * structure.ties + 0.3 * (structure.above or structure.below)
    return (before, *(1.0 if bits == 1 else 1.4 for bits in structure.row_bits), after)


def long_structure(
    dividend: Operand, divisor: Operand, form: Fixed, rounding: Rounding, radix: int
) -> LongStructure:
    """The structure of a long division: only the rows that the quotient can need."""
    biasing = Rounding.HALF_UP if rounding is Rounding.HALF_EVEN else rounding
    low, high = _quotients(dividend, divisor, form.fraction, biasing)
    inner_low, inner_high = max(low, form.lowest), min(high, form.highest)
    zero = divisor.low == 0
    nearest = biasing is Rounding.HALF_UP
    return LongStructure(
        rows=max(bits_of(min(inner_low, 0), max(inner_high, 0)) - (inner_low < 0), 1),
        radix=radix,
        row_width=divisor.high.bit_length() + 1,
        negative=low < 0 or (zero and dividend.low < 0),
        biased=(nearest and dividend.low != dividend.high)
        or (rounding is Rounding.TOWARD_ZERO and dividend.signed),
        ties=rounding is Rounding.HALF_EVEN,
        above=high > form.highest or (zero and dividend.high >= 0),
        below=low < form.lowest or (zero and dividend.low < 0),
    )


def _quotients(dividend: Operand, divisor: Operand, fraction: int, rounding: Rounding) -> tuple[int, int]:
    """The least and the greatest quotient, rounded but not clamped, of a divisor that is not zero."""
    wide = Fixed(width=_UNBOUNDED_BITS, fraction=fraction)
    nearest_zero, farthest = max(divisor.high, 1), max(divisor.low, 1)

    def quotient(raw: int, by: int) -> int:
        return divide(raw, dividend.form.fraction, by, divisor.form.fraction, wide, rounding)[0]

    return (
        quotient(dividend.low, farthest if dividend.low < 0 else nearest_zero),
        quotient(dividend.high, nearest_zero if dividend.high < 0 else farthest),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class NewtonStep:
    """One iteration: two multiplications, each with its sum.

    The first multiplies the divisor, shifted left, by the value of ``fraction + 1`` bits (an entry of
    the table is stored negated, with its sign: ``fraction + 2``). Only the last ``difference_bits`` of
    the product matter: the rest is known, as the factor is 1 plus a small change. The second multiplies
    the value by that change of ``change_bits``, signed, and adds it to the value.
    """

    fraction: int
    target: int
    dropped: int
    change_bits: int

    @property
    def kept(self) -> int:
        """Fraction bits of the factor."""
        return self.target + 2

    @property
    def difference_bits(self) -> int:
        """Bits of the first product that the change is made of."""
        return max(self.change_bits + self.dropped, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableStructure:
    """A reciprocal from a table.

    The divisor's length, ``shortest`` to ``longest`` bits, is one of ``positions``: it is shifted left by a
    selection among so many, and the result shifted back by another. Shorter divisors saturate without
    being looked at. The result is clamped if ``above``.
    """

    longest: int
    shortest: int
    steps: tuple[NewtonStep, ...]
    above: bool

    @property
    def positions(self) -> int:
        """The shifts that the divisor can need."""
        return self.longest - self.shortest + 1


def table_structure(divisor: Operand, form: Fixed, rounding: Rounding, method: TableNewton) -> TableStructure:
    """The structure of a reciprocal from a table: only the shifts that the divisor can need."""
    longest = max(divisor.high.bit_length(), 1)
    fraction = method.fractions(form)[-1]
    steps, error = _newton_steps(longest, method, form)

    def result(approximation: Fraction, bits: int) -> int:
        dropped = fraction + bits - divisor.form.fraction - form.fraction
        return int(rounded(int(approximation * (1 << fraction)), dropped, rounding))

    def least(bits: int) -> int:
        return result((1 - error) * Fraction(1 << bits, (1 << bits) - 1), bits)

    lengths = range(max(divisor.low, 1).bit_length(), longest + 1)
    shortest = next((bits for bits in lengths if least(bits) <= form.highest), longest)
    # Of the shortest divisors only those from ``low`` on can be there, and no approximation reaches 2.
    greatest = (1 + error) * Fraction(1 << lengths[0], max(divisor.low, 1))
    greatest = min(greatest, 2 - Fraction(1, 1 << fraction))
    return TableStructure(
        longest=longest,
        shortest=shortest,
        steps=steps,
        above=divisor.low == 0 or result(greatest, lengths[0]) > form.highest,
    )


def _newton_steps(longest: int, method: TableNewton, form: Fixed) -> tuple[tuple[NewtonStep, ...], Fraction]:
    """The iterations, and a bound of |1 - divisor * approximation| after the last of them."""
    steps = []
    error = _table_error(method)
    for fraction, target in pairwise(method.fractions(form)):
        kept = target + 2
        bound = ceil(error * (1 << kept)) + 1
        steps.append(
            NewtonStep(
                fraction=fraction,
                target=target,
                dropped=longest + fraction - kept,
                change_bits=bits_of(-bound, bound),
            )
        )
        # Newton squares the error; then the factor and the product are truncated.
        error = error**2 + (1 + error) * Fraction(1, 1 << kept) + Fraction(1, 1 << target)
    return tuple(steps), error


def _table_error(method: TableNewton) -> Fraction:
    count = 1 << method.index_bits
    unit = 2 * count << method.table_fraction
    worst = max(
        abs(unit - edge * entry)
        for index, entry in enumerate(reciprocal_table(method.index_bits))
        for edge in (count + index, count + index + 1)
    )
    return Fraction(worst, unit)


def in_one_table(divisor: Operand, method: TableNewton) -> bool:
    """Whether the table addressed by the whole divisor is no larger than twice the method's own.

    Then every reciprocal is looked up as it comes out, and nothing is shifted.
    """
    return divisor.width <= method.index_bits + 1
