"""How good an estimate is: errors, consistency (NIS, NEES), whiteness of innovations.

Arrays are (steps, tracks) or (steps, tracks, n); NaN marks what does not count.
Source of the consistency tests: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking
and Navigation, section 5.4.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """The mean of a quadratic form over ``samples``, and the band that holds 95 % of such means."""

    mean: float
    low: float
    high: float
    samples: int

    @property
    def consistent(self) -> bool:
        """Whether the mean lies in its band."""
        return self.low <= self.mean <= self.high


def rmse(estimate: Array, against: Array) -> Array:
    """The root mean square error of each state. Shapes: (steps, tracks, n); result (n). NaN: no sample."""
    squares = np.square(estimate - against)
    counted = ~np.isnan(squares)
    count = counted.sum(axis=(0, 1))
    total = np.where(counted, squares, 0.0).sum(axis=(0, 1))
    return np.asarray(np.sqrt(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)))


def nees(error: Array, P: Array) -> Array:
    """Normalised squared errors e' P^-1 e. Shapes: (..., n) and (..., n, n); result (...)."""
    return np.asarray((error * np.linalg.solve(P, error[..., None])[..., 0]).sum(axis=-1))


def consistency(values: Array, degrees: int) -> Consistency:
    """The mean of NIS or NEES values of ``degrees`` dimensions, with its chi-square band of 95 %."""
    counted = values[~np.isnan(values)]
    low, high = mean_band(degrees, max(counted.size, 1))
    mean = float(counted.mean()) if counted.size else math.nan
    return Consistency(mean=mean, low=low, high=high, samples=int(counted.size))


def mean_band(degrees: int, samples: int) -> tuple[float, float]:
    """The limits that hold 95 % of the means of ``samples`` chi-square numbers of ``degrees``."""
    total = degrees * samples
    return chi_square_quantile(0.025, total) / samples, chi_square_quantile(0.975, total) / samples


def autocorrelation(innovation: Array, lag: int = 1) -> Array:
    """The correlation of each innovation with the one ``lag`` steps later, zero if white.

    Shapes: (steps, tracks, m), result (m); pairs with a NaN do not count. With N pairs a white sequence
    stays within 1.96 / sqrt(N) in 95 % of cases.
    """
    early, late = innovation[:-lag], innovation[lag:]
    counted = ~(np.isnan(early) | np.isnan(late))
    a, b = np.where(counted, early, 0.0), np.where(counted, late, 0.0)
    scale = np.sqrt((a * a).sum(axis=(0, 1)) * (b * b).sum(axis=(0, 1)))
    product = (a * b).sum(axis=(0, 1))
    return np.asarray(np.divide(product, scale, out=np.full(scale.shape, np.nan), where=scale > 0))


def chi_square_quantile(probability: float, degrees: int) -> float:
    """The number that a chi-square variable of ``degrees`` stays below with a probability, 0 < p < 1."""
    low, high = 0.0, 2.0 * degrees + 100.0
    while _gamma_below(degrees / 2, high / 2) < probability:
        high *= 2
    for _ in range(200):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        if _gamma_below(degrees / 2, middle / 2) < probability:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def _gamma_below(a: float, x: float) -> float:
    """The regularised lower incomplete gamma function P(a, x)."""
    if x <= 0:
        return 0.0
    scale = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1:
        return scale * _series(a, x)
    return 1.0 - scale * _continued_fraction(a, x)


def _series(a: float, x: float) -> float:
    """The sum of x**k / (a (a + 1) ... (a + k)); Abramowitz and Stegun, 6.5.29."""
    term = total = 1.0 / a
    k = a
    while term > total * 1e-17:
        k += 1
        term *= x / k
        total += term
    return total


def _continued_fraction(a: float, x: float) -> float:
    """The upper incomplete gamma function without its scale, by Lentz's method; ibid., 6.5.31."""
    tiny = 1e-300
    b = x + 1 - a
    c, d = 1 / tiny, 1 / b
    fraction = d
    for i in range(1, 100_000):
        step = -i * (i - a)
        b += 2
        d = 1 / (step * d + b or tiny)
        c = step / c + b or tiny
        fraction *= c * d
        if abs(c * d - 1) < 1e-16:
            break
    return fraction
