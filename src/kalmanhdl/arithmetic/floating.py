"""Binary floating-point formats, and the one definition of their arithmetic.

Numbers are raw integers in the interchange encoding of IEEE 754-2019, section 3.4: sign, biased exponent,
fraction. Every operation is the exact result of its operands, rounded once (section 4.3). There is one NaN.
"""

import math
from dataclasses import dataclass
from fractions import Fraction

from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.errors import FormatError

MODES = (Rounding.HALF_EVEN, Rounding.TOWARD_ZERO)
EXPONENTS, MANTISSAS = range(2, 20), range(1, 237)


@dataclass(frozen=True, slots=True)
class Float:
    """A format of ``exponent`` and ``mantissa`` bits, the leading one hidden: (8, 23) is single precision.

    ``subnormals``: numbers below the least normal one are kept; otherwise they count as zeros, as operands
    and as results (a result is judged after it was rounded as if exponents had no end).

    Raises:
        FormatError: a size or a rounding that is not offered.
    """

    exponent: int
    mantissa: int
    rounding: Rounding = Rounding.HALF_EVEN
    subnormals: bool = True

    def __post_init__(self) -> None:
        if self.exponent not in EXPONENTS or self.mantissa not in MANTISSAS:
            raise FormatError(
                f"{self}: an exponent has {EXPONENTS[0]} to {EXPONENTS[-1]} bits, "
                f"a mantissa {MANTISSAS[0]} to {MANTISSAS[-1]}"
            )
        if self.rounding not in MODES:
            words = " or ".join(mode.value for mode in MODES)
            raise FormatError(f"{self}: rounding {self.rounding.value} is not for floating point: {words}")

    @property
    def width(self) -> int:
        """Bits of a number."""
        return 1 + self.exponent + self.mantissa

    @property
    def bias(self) -> int:
        """What the encoded exponent is larger by."""
        return (1 << (self.exponent - 1)) - 1

    @property
    def infinity(self) -> int:
        """The raw integer of positive infinity."""
        return ((1 << self.exponent) - 1) << self.mantissa

    @property
    def nan(self) -> int:
        """The raw integer of the one NaN."""
        return self.infinity | 1 << (self.mantissa - 1)

    @property
    def highest(self) -> int:
        """The raw integer of the greatest finite number."""
        return self.infinity - 1

    @property
    def sign(self) -> int:
        """The bit of the sign."""
        return 1 << (self.width - 1)

    def magnitude(self, raw: int) -> int:
        """The raw integer without its sign; of a subnormal that does not count, zero."""
        bits = raw & (self.sign - 1)
        return 0 if not self.subnormals and bits >> self.mantissa == 0 else bits

    def canonical(self, raw: int) -> int:
        """The raw integer as it is kept: the one NaN, and zero for a subnormal that does not count."""
        return self.nan if self.is_nan(raw) else self.magnitude(raw) | raw & self.sign

    def is_nan(self, raw: int) -> bool:
        """Whether a raw integer is no number."""
        return self.magnitude(raw) > self.infinity

    def is_infinite(self, raw: int) -> bool:
        """Whether a raw integer is an infinity."""
        return self.magnitude(raw) == self.infinity

    def real(self, raw: int) -> Fraction:
        """The exact value of a finite number."""
        bits = self.magnitude(raw)
        exponent, fraction = bits >> self.mantissa, bits & ((1 << self.mantissa) - 1)
        significand = fraction | (exponent > 0) << self.mantissa
        value = significand * Fraction(2) ** (max(exponent, 1) - self.bias - self.mantissa)
        return -value if raw & self.sign else value

    def double(self, raw: int) -> float:
        """The nearest number of double precision; infinities and NaN as they are."""
        if self.is_nan(raw):
            return math.nan
        try:
            magnitude = math.inf if self.is_infinite(raw) else float(abs(self.real(raw)))
        except OverflowError:
            magnitude = math.inf
        return -magnitude if raw & self.sign else magnitude

    def nearest(self, value: float | Fraction) -> int:
        """The raw integer of a real value, rounded; infinities and NaN as they are."""
        if isinstance(value, float) and not math.isfinite(value):
            return self.nan if math.isnan(value) else self.infinity | (self.sign if value < 0 else 0)
        negative = math.copysign(1, value) < 0 if isinstance(value, float) else value < 0
        return encoded(self, negative, abs(Fraction(value)))

    def __str__(self) -> str:
        return f"float({self.exponent}, {self.mantissa})"


def encoded(form: Float, negative: bool, magnitude: Fraction) -> int:
    """A real number of any size, rounded once and encoded."""
    sign = form.sign if negative else 0
    if magnitude == 0:
        return sign
    exponent = _exponent(magnitude)
    if not form.subnormals:
        # Judged with the exponent that rounding leaves, however small.
        whole = _whole(form, magnitude, exponent - form.mantissa)
        if exponent + whole.bit_length() - form.mantissa - 1 < 1 - form.bias:
            return sign
    last = max(exponent, 1 - form.bias) - form.mantissa
    whole = _whole(form, magnitude, last)
    # A significand that rounds up to the next power of two carries into the exponent by itself.
    bits = whole + max(last + form.mantissa + form.bias - 1, 0) * (1 << form.mantissa)
    if bits >= form.infinity:
        bits = form.highest if form.rounding is Rounding.TOWARD_ZERO else form.infinity
    return sign | bits


def _exponent(magnitude: Fraction) -> int:
    """The exponent of the power of two at or below a positive number."""
    exponent = magnitude.numerator.bit_length() - magnitude.denominator.bit_length()
    return exponent if magnitude >= Fraction(2) ** exponent else exponent - 1


def _whole(form: Float, magnitude: Fraction, last: int) -> int:
    """The number in units of 2**last, rounded to an integer."""
    units = magnitude / Fraction(2) ** last
    return math.floor(units) if form.rounding is Rounding.TOWARD_ZERO else round(units)


def add(form: Float, a: int, b: int) -> int:
    """a + b."""
    if form.is_nan(a) or form.is_nan(b):
        return form.nan
    if form.is_infinite(a) or form.is_infinite(b):
        if form.is_infinite(a) and form.is_infinite(b):
            return a if a == b else form.nan
        return a if form.is_infinite(a) else b
    return _sum(form, form.real(a) + form.real(b), bool(a & form.sign), bool(b & form.sign))


def _sum(form: Float, exact: Fraction, a: bool, b: bool) -> int:
    """A sum with the sign of zero that the signs of its terms give (section 6.3)."""
    return encoded(form, exact < 0 if exact else a and b, abs(exact))


def subtract(form: Float, a: int, b: int) -> int:
    """a - b."""
    return add(form, a, b if form.is_nan(b) else b ^ form.sign)


def multiply(form: Float, a: int, b: int) -> int:
    """a * b."""
    if form.is_nan(a) or form.is_nan(b):
        return form.nan
    sign = (a ^ b) & form.sign
    if form.is_infinite(a) or form.is_infinite(b):
        zero = form.magnitude(a) == 0 or form.magnitude(b) == 0
        return form.nan if zero else form.infinity | sign
    return encoded(form, sign != 0, abs(form.real(a) * form.real(b)))


def fused_multiply_add(form: Float, a: int, b: int, c: int) -> int:
    """a * b + c, rounded once."""
    if form.is_nan(a) or form.is_nan(b) or form.is_nan(c):
        return form.nan
    negative = bool((a ^ b) & form.sign)
    if form.is_infinite(a) or form.is_infinite(b):
        product = multiply(form, a, b)
        return product if form.is_nan(product) else add(form, product, c)
    if form.is_infinite(c):
        return c
    return _sum(form, form.real(a) * form.real(b) + form.real(c), negative, bool(c & form.sign))


def divide(form: Float, a: int, b: int) -> int:
    """a / b."""
    if form.is_nan(a) or form.is_nan(b):
        return form.nan
    sign = (a ^ b) & form.sign
    if form.is_infinite(a):
        return form.nan if form.is_infinite(b) else form.infinity | sign
    if form.is_infinite(b):
        return sign
    if form.magnitude(b) == 0:
        return form.nan if form.magnitude(a) == 0 else form.infinity | sign
    return encoded(form, sign != 0, abs(form.real(a) / form.real(b)))


def square_root(form: Float, a: int) -> int:
    """The square root; of a negative number NaN, of a negative zero itself."""
    if form.is_nan(a):
        return form.nan
    if form.magnitude(a) == 0:
        return a & form.sign
    if a & form.sign:
        return form.nan
    if form.is_infinite(a):
        return a
    value = form.real(a)
    # Enough bits of the root that its remainder only tells on which side of a rounding boundary it lies.
    shift = 2 * (form.mantissa + 3) + abs(_exponent(value)) + 2
    shift += shift % 2
    units = value * (1 << shift)
    root = math.isqrt(units.numerator // units.denominator)
    if Fraction(root * root) == units:
        return encoded(form, False, Fraction(root, 1 << (shift // 2)))
    return encoded(form, False, Fraction(2 * root + 1, 1 << (shift // 2 + 1)))


def negate(form: Float, a: int) -> int:
    """a with the other sign."""
    return form.nan if form.is_nan(a) else form.canonical(a) ^ form.sign


def scale(form: Float, a: int, exponent: int) -> int:
    """a * 2**exponent."""
    if form.is_nan(a) or form.is_infinite(a):
        return form.canonical(a)
    return encoded(form, bool(a & form.sign), abs(form.real(a)) * Fraction(2) ** exponent)


def wrap(form: Float, a: int) -> int:
    """a less the nearest whole number, exact: from -1/2 to below 1/2, zero without sign; of infinity NaN."""
    if form.magnitude(a) >= form.infinity:
        return form.nan
    value = form.real(a)
    rest = value - math.floor(value + Fraction(1, 2))
    return encoded(form, rest < 0, abs(rest))


LESS, EQUAL, GREATER, UNORDERED = range(4)


def compare(form: Float, a: int, b: int) -> int:
    """How a stands to b; to NaN nothing is ordered, and zeros are equal."""
    if form.is_nan(a) or form.is_nan(b):
        return UNORDERED
    x, y = (-form.magnitude(raw) if raw & form.sign else form.magnitude(raw) for raw in (a, b))
    return LESS if x < y else EQUAL if x == y else GREATER


def to_fixed(form: Float, a: int, fixed: Fixed) -> int:
    """The raw integer of a in a fixed-point format, rounded as ``form`` rounds, beyond its limits the limit.

    Of NaN it is zero.
    """
    if form.is_nan(a):
        return 0
    if form.is_infinite(a):
        return fixed.lowest if a & form.sign else fixed.highest
    whole = _whole(form, abs(form.real(a)), -fixed.fraction)
    return min(max(-whole if a & form.sign else whole, fixed.lowest), fixed.highest)


def from_fixed(form: Float, raw: int, fixed: Fixed) -> int:
    """The number of a raw integer in a fixed-point format."""
    return encoded(form, raw < 0, abs(fixed.real(raw)))


def is_negative(form: Float, a: int) -> bool:
    """a < 0, which neither NaN nor a negative zero is."""
    return bool(a & form.sign) and 0 < form.magnitude(a) <= form.infinity
