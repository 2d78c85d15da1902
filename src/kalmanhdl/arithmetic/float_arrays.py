"""Arrays of floating-point numbers: ``floating`` on every element, and the order in which sums are rounded.

Numbers of short formats are doubles on the way: the exact result of two of them, rounded to a double and then
to the format, is rounded once as long as a double has twice the digits and two more (Figueroa, When is double
rounding innocuous?, 1995). Other formats are computed by ``floating`` itself, element by element.
"""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from kalmanhdl.arithmetic import floating
from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.floating import Float

Numbers = npt.NDArray[Any]
"""Numbers as the arithmetic that made them holds them."""

# No result of two numbers leaves the doubles, and a double has twice their digits and two more.
_MOST_EXPONENT, _MOST_MANTISSA = 9, 24
_WORDS = {(8, 23): (np.uint32, np.float32), (5, 10): (np.uint16, np.float16)}


class FloatArrays(Protocol):
    """The arithmetic of a format on arrays, which broadcast."""

    def load(self, raws: Sequence[int]) -> Numbers:
        """Encoded numbers."""

    def store(self, numbers: Numbers) -> list[int]:
        """The encoding of numbers, of an array in its order."""

    def add(self, a: Numbers, b: Numbers) -> Numbers:
        """a + b."""

    def subtract(self, a: Numbers, b: Numbers) -> Numbers:
        """a - b."""

    def multiply(self, a: Numbers, b: Numbers) -> Numbers:
        """a * b."""

    def divide(self, a: Numbers, b: Numbers) -> Numbers:
        """a / b."""


@cache
def float_arrays(form: Float) -> FloatArrays:
    """The arithmetic of a format."""
    short = form.exponent <= _MOST_EXPONENT and form.mantissa <= _MOST_MANTISSA
    return _Doubles(form) if short and form.rounding is Rounding.HALF_EVEN else _Raws(form)


def summed(arrays: FloatArrays, terms: Numbers) -> Numbers:
    """The sum of terms (..., k) over the last axis.

    Neighbours are added, then neighbours of these sums, and so on; of an odd number the last one waits. Every
    addition rounds.
    """
    while terms.shape[-1] > 1:
        pairs = terms.shape[-1] // 2
        left, right = terms[..., : 2 * pairs : 2], terms[..., 1 : 2 * pairs : 2]
        terms = np.concatenate([arrays.add(left, right), terms[..., 2 * pairs :]], axis=-1)
    return terms[..., 0]


def doubles(form: Float, raws: Sequence[int]) -> npt.NDArray[np.float64]:
    """The values of encoded numbers; what is beyond the doubles is rounded as they are."""
    short = _WORDS.get((form.exponent, form.mantissa)) if form.subnormals else None
    if short:
        return np.array(raws, short[0]).view(short[1]).astype(np.float64)
    if form.width > 63:
        return np.array([form.double(raw) for raw in raws])
    given = np.array(raws, np.int64)
    exponent, fraction = (given & form.sign - 1) >> form.mantissa, given & (1 << form.mantissa) - 1
    hidden = (exponent > 0).astype(np.int64) << form.mantissa
    significand = fraction | hidden if form.subnormals else np.where(exponent > 0, fraction | hidden, 0)
    last = np.maximum(exponent, 1) - form.bias - form.mantissa
    with np.errstate(over="ignore"):
        magnitude = np.ldexp(significand.astype(np.float64), last)
    ended = exponent == (1 << form.exponent) - 1
    magnitude = np.where(ended, np.where(fraction > 0, np.nan, np.inf), magnitude)
    return np.copysign(magnitude, np.where(given & form.sign, -1.0, 1.0))


class _Doubles:
    """Numbers of a short format as doubles."""

    def __init__(self, form: Float) -> None:
        self._form = form
        self._short = _WORDS.get((form.exponent, form.mantissa)) if form.subnormals else None

    def load(self, raws: Sequence[int]) -> Numbers:
        return doubles(self._form, raws)

    def store(self, numbers: Numbers) -> list[int]:
        form, values = self._form, np.ravel(numbers)
        if self._short:
            raws = values.astype(self._short[1]).view(self._short[0]).astype(np.int64)
        else:
            raws = self._encoded(values)
        found: list[int] = np.where(np.isnan(values), form.nan, raws).tolist()
        return found

    def add(self, a: Numbers, b: Numbers) -> Numbers:
        with np.errstate(all="ignore"):
            return self._rounded(a + b)

    def subtract(self, a: Numbers, b: Numbers) -> Numbers:
        with np.errstate(all="ignore"):
            return self._rounded(a - b)

    def multiply(self, a: Numbers, b: Numbers) -> Numbers:
        with np.errstate(all="ignore"):
            return self._rounded(a * b)

    def divide(self, a: Numbers, b: Numbers) -> Numbers:
        with np.errstate(all="ignore"):
            return self._rounded(np.divide(a, b))

    def _rounded(self, exact: Numbers) -> Numbers:
        form = self._form
        if self._short:
            return exact.astype(self._short[1]).astype(np.float64)
        last = np.frexp(exact)[1] - 1 - form.mantissa
        if form.subnormals:
            last = np.maximum(last, 1 - form.bias - form.mantissa)
        found = np.ldexp(np.rint(np.ldexp(exact, -last)), last)
        magnitude = np.abs(found)
        if not form.subnormals:
            magnitude = np.where(magnitude < 2.0 ** (1 - form.bias), 0.0, magnitude)
        magnitude = np.where(magnitude >= 2.0 ** (form.bias + 1), np.inf, magnitude)
        signed: Numbers = np.copysign(magnitude, found)
        return signed

    def _encoded(self, values: Numbers) -> Numbers:
        form = self._form
        magnitude = np.where(np.isfinite(values), np.abs(values), 0.0)
        exponent = np.maximum(np.frexp(magnitude)[1] - 1, 1 - form.bias)
        whole = np.ldexp(magnitude, form.mantissa - exponent).astype(np.int64)
        # The leading bit of the significand carries into the exponent.
        bits = whole + ((exponent.astype(np.int64) + form.bias - 1) << form.mantissa)
        bits = np.where(np.isinf(values), form.infinity, np.where(magnitude > 0, bits, 0))
        return bits | np.where(np.signbit(values), form.sign, 0)


class _Raws:
    """Encoded numbers, computed by the definition itself."""

    def __init__(self, form: Float) -> None:
        self.add = self._elementwise(floating.add, form)
        self.subtract = self._elementwise(floating.subtract, form)
        self.multiply = self._elementwise(floating.multiply, form)
        self.divide = self._elementwise(floating.divide, form)

    @staticmethod
    def _elementwise(operation: Any, form: Float) -> Any:
        return np.frompyfunc(partial(operation, form), 2, 1)

    def load(self, raws: Sequence[int]) -> Numbers:
        return np.array(raws, object)

    def store(self, numbers: Numbers) -> list[int]:
        return [int(raw) for raw in np.ravel(numbers)]
