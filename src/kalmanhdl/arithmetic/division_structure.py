"""How large the hardware of a division is, from what is known about its operands.

Cores and schedulers both ask here, so that an estimate speaks of the rows that are built.
"""

from dataclasses import dataclass

from kalmanhdl.arithmetic.division import divide
from kalmanhdl.arithmetic.fixed import Fixed, Rounding

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
