"""Fixed-point formats, and the one definition of rounding and overflow.

The definitions are written over any integers that know ``+ - >> & < ==``: Python's own, Amaranth
values, or expressions of the generated C. Engine, hardware and proofs call these same functions, so
that they cannot drift apart.
"""

from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import Any, Protocol

from kalmanhdl.errors import FormatError
from kalmanhdl.validation import as_flag, as_integer, shown


class Rounding(Enum):
    """What becomes of the bits below the last one kept."""

    FLOOR = "floor"
    HALF_UP = "half_up"
    HALF_EVEN = "half_even"
    TOWARD_ZERO = "toward_zero"


class Overflow(Enum):
    """What becomes of a value outside the format."""

    WRAP = "wrap"
    SATURATE = "saturate"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixed:
    """A fixed-point format: value = raw * 2**-fraction, raw of ``width`` bits.

    ``fraction`` may be negative or larger than ``width``: the binary point need not lie inside.
    """

    width: int
    fraction: int
    signed: bool = True

    def __post_init__(self) -> None:
        if type(self.width) is not int or type(self.fraction) is not int or type(self.signed) is not bool:
            self._settle()
        if self.width < 1:
            raise FormatError(f"fixed({self.width}, fraction={self.fraction}): a width is 1 bit or more")

    def _settle(self) -> None:
        """Make NumPy's numbers Python's, whose shifts never overflow."""
        found = {key: as_integer(getattr(self, key)) for key in ("width", "fraction")}
        found["signed"] = as_flag(self.signed)
        for key, value in found.items():
            if value is None:
                rule = "true or false" if key == "signed" else "an integer"
                raise FormatError(f"{key} = {shown(getattr(self, key))} of a fixed-point format: {rule}")
            object.__setattr__(self, key, value)

    @property
    def lowest(self) -> int:
        """The least raw integer."""
        return -(1 << (self.width - 1)) if self.signed else 0

    @property
    def highest(self) -> int:
        """The greatest raw integer."""
        return (1 << (self.width - 1 if self.signed else self.width)) - 1

    @property
    def resolution(self) -> Fraction:
        """The real value of the last bit."""
        return Fraction(2) ** -self.fraction

    def real(self, raw: int) -> Fraction:
        """The exact real value of a raw integer."""
        return raw * self.resolution

    def nearest(self, value: float | Fraction) -> int:
        """The raw integer nearest to a real value, ties to even, clamped to the format."""
        raw = round(Fraction(value) / self.resolution)
        return min(max(raw, self.lowest), self.highest)

    def __str__(self) -> str:
        return f"{'' if self.signed else 'u'}fixed({self.width}, fraction={self.fraction})"


def stands_below(lower: Fixed, upper: Fixed) -> bool:
    """Whether all bits of one format come after the last one of another: a sum has the bits of both."""
    return not lower.signed and lower.fraction - upper.fraction >= lower.width


def rounded(raw: Any, dropped: int, rounding: Rounding) -> Any:
    """Drop the last ``dropped`` bits of a raw integer; a negative count appends zeros.

    The result is exact for every rounding mode: a bias that depends only on the sign and on the last
    bit kept, then an arithmetic shift (a floor).
    """
    if dropped <= 0:
        return raw << -dropped if dropped else raw
    if rounding is Rounding.FLOOR:
        return raw >> dropped
    return (raw + rounding_bias(raw, dropped, rounding)) >> dropped


def rounding_bias(raw: Any, dropped: int, rounding: Rounding) -> Any:
    """What is added to a raw integer before its last ``dropped`` bits, one or more, are cut off."""
    match rounding:
        case Rounding.FLOOR:
            return 0
        case Rounding.HALF_UP:
            return 1 << (dropped - 1)
        case Rounding.HALF_EVEN:
            return ((raw >> dropped) & 1) + ((1 << (dropped - 1)) - 1)
        case Rounding.TOWARD_ZERO:
            return -(raw < 0) & ((1 << dropped) - 1)


def outside(raw: Any, form: Fixed) -> Any:
    """Whether a raw integer, already at the format's fraction, lies outside of it."""
    if form.signed:
        top = raw >> (form.width - 1)
        return (top != 0) & (top != -1)
    return (raw >> form.width) != 0


class _Choose(Protocol):
    """``choose(condition, if_true, if_false)`` in the integers at hand."""

    def __call__(self, condition: Any, if_true: Any, if_false: Any, /) -> Any: ...


def saturated(raw: Any, form: Fixed, choose: _Choose) -> Any:
    """The nearest raw integer inside the format."""
    limit = choose(raw < 0, form.lowest, form.highest)
    return choose(outside(raw, form), limit, raw)


def wrapped(raw: Any, form: Fixed) -> Any:
    """The raw integer of the format that is congruent modulo 2**width."""
    low = raw & ((1 << form.width) - 1)
    if not form.signed:
        return low
    half = 1 << (form.width - 1)
    return (low ^ half) - half


def _choose(condition: Any, if_true: Any, if_false: Any) -> Any:
    return if_true if condition else if_false


def quantise(
    raw: int, fraction: int, form: Fixed, rounding: Rounding, overflow: Overflow
) -> tuple[int, bool]:
    """Bring a raw integer of some ``fraction`` into a format.

    Returns the raw integer of the format, and whether the rounded value lay outside of it.
    """
    at_fraction = rounded(raw, fraction - form.fraction, rounding)
    if overflow is Overflow.SATURATE:
        inside = saturated(at_fraction, form, _choose)
    else:
        inside = wrapped(at_fraction, form)
    return inside, bool(outside(at_fraction, form))
