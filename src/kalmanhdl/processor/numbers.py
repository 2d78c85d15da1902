"""The numbers of a core, fixed or floating point: what a raw integer is, and which one a value becomes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.float_arrays import doubles
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.errors import ProgramError

Array = npt.NDArray[np.float64]

NARROWEST, WIDEST = 8, 32
"""Bits of a core's words."""

_EXPONENTS = range(-256, 256)


class Numbers(Protocol):
    """A format of words. A raw fixed-point number has its sign, a floating-point one is its bits."""

    def taken(self, raw: int) -> int:
        """What READ keeps of the bits of an input."""

    def nearest(self, value: float) -> int:
        """The raw number of a real value."""

    def reals(self, raws: Sequence[int]) -> Array:
        """The values of raw numbers."""

    def holds(self, value: float) -> bool:
        """Whether a constant is a number of the format, but for its rounding."""

    def is_zero(self, raw: int) -> bool:
        """Whether a raw number is zero, of whichever sign."""

    def is_end(self, raw: int) -> bool:
        """Whether a number is as large as there is one: what was measured may have been clipped."""

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the greatest real value."""

    @property
    def exponents(self) -> range:
        """The powers of two that are numbers of the format."""


@dataclass(frozen=True, slots=True)
class FixedNumbers:
    """Words of a fixed-point format."""

    form: Fixed

    def taken(self, raw: int) -> int:
        """As it is."""
        return raw

    def nearest(self, value: float) -> int:
        """Beyond the limits the limit."""
        return self.form.nearest(value)

    def reals(self, raws: Sequence[int]) -> Array:
        """Exact, as words have fewer bits than the significand of a double."""
        return np.array(raws, float) * float(self.form.resolution)

    def holds(self, value: float) -> bool:
        """Within the limits, and not so small that nothing of it is left."""
        raw = self.form.nearest(value)
        off = abs(float(self.form.real(raw)) - value)
        return off <= float(self.form.resolution) and (raw != 0 or value == 0)

    def is_zero(self, raw: int) -> bool:
        """There is one zero."""
        return raw == 0

    def is_end(self, raw: int) -> bool:
        """At one of the limits."""
        return raw in (self.form.lowest, self.form.highest)

    @property
    def limits(self) -> tuple[float, float]:
        """Of a number with a sign."""
        low, high = (float(self.form.real(raw)) for raw in (self.form.lowest, self.form.highest))
        return low, high

    @property
    def exponents(self) -> range:
        """From the last bit to the one below the sign."""
        return range(-self.form.fraction, self.form.width - 1 - self.form.fraction)


@dataclass(frozen=True, slots=True)
class FloatNumbers:
    """Words of a floating-point format."""

    form: Float

    def taken(self, raw: int) -> int:
        """The one NaN for any, and zero for a subnormal that does not count."""
        return self.form.canonical(raw & (1 << self.form.width) - 1)

    def nearest(self, value: float) -> int:
        """Beyond the limits infinity."""
        return self.form.nearest(value)

    def reals(self, raws: Sequence[int]) -> Array:
        """Infinities and NaN as they are."""
        return doubles(self.form, raws)

    def holds(self, value: float) -> bool:
        """Neither rounded to infinity nor to zero."""
        magnitude = self.form.magnitude(self.form.nearest(value))
        return magnitude < self.form.infinity and (magnitude > 0 or value == 0)

    def is_zero(self, raw: int) -> bool:
        """There are two."""
        return self.form.magnitude(raw) == 0

    def is_end(self, raw: int) -> bool:
        """Infinite or NaN."""
        return self.form.magnitude(raw) >= self.form.infinity

    @property
    def limits(self) -> tuple[float, float]:
        """Of finite numbers."""
        highest = self.form.double(self.form.highest)
        return -highest, highest

    @property
    def exponents(self) -> range:
        """From the least number to the greatest, as far as an argument of nine bits reaches."""
        form = self.form
        least = 1 - form.bias - (form.mantissa if form.subnormals else 0)
        return range(max(least, _EXPONENTS[0]), min(form.bias, _EXPONENTS[-1]) + 1)


def numbers_of(form: Fixed | Float) -> Numbers:
    """The numbers of a format."""
    return FixedNumbers(form) if isinstance(form, Fixed) else FloatNumbers(form)


def check_words(form: Fixed | Float) -> None:
    """Raises ProgramError for a format that the words of a core cannot have."""
    fits = NARROWEST <= form.width <= WIDEST
    if isinstance(form, Float):
        if not fits:
            raise ProgramError(
                f"core: {form} has words of {form.width} bits, and a core has {NARROWEST} to {WIDEST}: "
                'use "single", "half", or other bits for exponent and mantissa'
            )
        return
    if not (form.signed and fits):
        raise ProgramError(
            f"core: {form}: the words of a core are signed and have {NARROWEST} to {WIDEST} bits"
        )
    if not 0 <= form.fraction <= form.width:
        raise ProgramError(f"core: {form}: its point stands inside the word, 0 to {form.width}")


def shortest(values: Iterable[float]) -> str:
    """Values as the shortest decimals that are these doubles."""
    return " ".join(map(repr, map(float, values)))
