"""Arrays of reals as raw integers of a floating-point format, and back."""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.simulate.limbs import Integers

Array = NDArray[np.float64]

# The formats of NumPy, whose conversions round to the nearest, ties to even.
_NUMPY = {
    Float(5, 10): (np.float16, np.uint16),
    Float(8, 23): (np.float32, np.uint32),
    Float(11, 52): (np.float64, np.uint64),
}


def float_raws(real: Array, form: Float) -> tuple[Integers, NDArray[np.bool_]]:
    """The raw integers of reals, rounded as the format rounds, and where they are beyond its numbers."""
    if form in _NUMPY:
        number, integer = _NUMPY[form]
        with np.errstate(over="ignore"):
            raws: Integers = real.astype(number).view(integer)
    else:
        kind = np.uint64 if form.width <= 64 else object
        raws = np.vectorize(form.nearest, otypes=[object])(real).astype(kind)
    # Some formats round what is beyond to the greatest number, others reach further than doubles.
    beyond = np.abs(real) >= (2.0 ** (form.bias + 1) if form.bias < 1023 else np.inf)
    return raws, np.isfinite(real) & (beyond | (raws & (form.sign - 1) == form.infinity))


def float_reals(raws: Integers, form: Float) -> Array:
    """Raw integers as the nearest reals of double precision."""
    if form in _NUMPY:
        number, integer = _NUMPY[form]
        return np.asarray(raws, integer).view(number).astype(np.float64)
    if form.width > 64:
        return np.asarray(np.vectorize(form.double, otypes=[np.float64])(raws))
    bits = np.asarray(raws, np.uint64)
    magnitude = bits & np.uint64(form.sign - 1)
    exponent = (magnitude >> np.uint64(form.mantissa)).astype(np.int64)
    fraction = magnitude & np.uint64((1 << form.mantissa) - 1)
    significand = fraction + ((exponent > 0).astype(np.uint64) << np.uint64(form.mantissa))
    if not form.subnormals:
        significand = np.where(exponent > 0, significand, np.uint64(0))
    power = np.maximum(exponent, 1) - form.bias - form.mantissa
    with np.errstate(over="ignore", under="ignore"):
        real = np.ldexp(significand.astype(np.float64), power)
    ended = exponent == (1 << form.exponent) - 1
    real = np.where(ended, np.where(fraction == 0, np.inf, np.nan), real)
    return np.asarray(np.where(bits & np.uint64(form.sign), -real, real))
