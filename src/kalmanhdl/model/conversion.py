"""Polar and spherical measurements as Cartesian positions: mean without bias, and covariance.

A bearing is counted from the first axis towards the second, an elevation up from their plane. The noises
of range, bearing and elevation are independent and Gaussian, sigma^2 each. With e = exp(-sigma^2) of an
angle a that was measured, what is averaged over the noises is, per angle,

    twice noisy   E cos^2 = (1 + e^4 cos 2a) / 2 = Bp cos^2 a + Bq sin^2 a
    the mean's    (E cos)^2: A = Ap cos^2 a + Aq sin^2 a with Ap, Aq = (e + e^3) / 2, (e - e^3) / 2

and the covariance is a sum of products of those. Its printed forms are differences of such products, equal
to six digits at sigma = 1 mrad; here B - A = D has constants of its own, (1 - e)(1 -+ e^3) / 2, so that
diagonal entries are sums of positive terms: with u = r^2 + sigma_r^2,

    R_xx = u (D_a B_e + A_a D_e) + sigma_r^2 B_a B_e       (a: azimuth, e: elevation).

In the plane R_xy is a difference all the same, which vanishes at one range, where the noise is a circle: it
is a multiple of r^2 - r0^2, with r0^2 = sigma_r^2 e / (1 - e) - sigma_r^2 in two parts.

Source: Lerro and Bar-Shalom, IEEE Transactions on Aerospace and Electronic Systems 29(3), 1993, in the plane;
Suchomski, ibid. 35(3), 1999, in space; derived anew, since wu2012, eq. 7, as printed, has sinh for cosh in
alpha_x, sigma_eta for sigma_theta in alpha_xy, 1 - exp(sigma_eta^2) for 2 - exp(sigma_eta^2) beside sigma_r^2
in R_xz and R_yz, and lacks R_yy and R_xy.
"""

import math
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Literal

import numpy as np

from kalmanhdl.graph.signal import Array
from kalmanhdl.math import atan2, cos, hypot, sin
from kalmanhdl.model.checks import fault
from kalmanhdl.model.exact import evaluation
from kalmanhdl.validation import shown

Unbiasing = Literal["debiased", "unbiased", "modified"]
UNBIASINGS = ("debiased", "unbiased", "modified")

Trigonometric = tuple[Any, Any]
"""Cosine and sine of an angle, as elements."""


@dataclass(frozen=True, slots=True)
class Sight:
    """Where a target is seen: the squared range, and the angles by cosine and sine; elements."""

    range_squared: Any
    azimuth: Trigonometric
    elevation: Trigonometric | None


@dataclass(frozen=True, slots=True)
class _Angle:
    """What an angle's noise makes of products of its cosine and sine; see above.

    ``B``, ``A`` and ``D`` are the factors of cos^2 and sin^2, ``across`` and ``across_difference`` those of
    cos sin in B and D, ``m`` that of the cosine alone.
    """

    B: tuple[float, float]
    A: tuple[float, float]
    D: tuple[float, float]
    across: float
    across_difference: float
    m: float


@dataclass(frozen=True, slots=True)
class Conversion:
    """The conversion of (range, bearing) or (range, azimuth, elevation), its constants evaluated exactly.

    ``factors`` are those of the converted x, y and z: (2,) or (3,). ``circular`` is the squared range at
    which the noise in the plane is a circle, in two parts whose sum is nearer to it than a double; None
    where there is none.
    """

    factors: tuple[float, ...]
    range_variance: float
    range_added: float
    azimuth: _Angle
    elevation: _Angle | None
    circular: tuple[float, float] | None

    def mean(self, z: Array) -> Array:
        """The position (2,) or (3,) of a measurement, over elements."""
        azimuth, elevation = _seen(z)
        if elevation is None:
            direction = [*azimuth]
        else:
            direction = [elevation[0] * azimuth[0], elevation[0] * azimuth[1], elevation[1]]
        return _vector([z[0] * (one * factor) for one, factor in zip(direction, self.factors, strict=True)])

    def covariance(self, sight: Sight, weight: float = 1.0) -> Array:
        """The covariance (2, 2) or (3, 3), times ``weight``, of a position seen so, over elements."""
        u, variance = (sight.range_squared + self.range_added) * weight, self.range_variance * weight
        if self.elevation is None or sight.elevation is None:
            return self._flat(sight, u, variance, weight)
        return _solid(self.azimuth, sight.azimuth, self.elevation, sight.elevation, u, variance)

    def _flat(self, sight: Sight, u: Any, variance: float, weight: float) -> Array:
        azimuth, angle = self.azimuth, sight.azimuth
        xx = u * _squares(azimuth.D, angle) + _squares(azimuth.B, angle) * variance
        yy = u * _squares(azimuth.D, angle[::-1]) + _squares(azimuth.B, angle[::-1]) * variance
        if self.circular is None:
            across = u * azimuth.across_difference + azimuth.across * variance
        else:
            beyond = (sight.range_squared - self.circular[0]) - self.circular[1]
            across = beyond * (azimuth.across_difference * weight)
        xy = angle[0] * angle[1] * across
        return _matrix([[xx, xy], [xy, yy]])


def _solid(
    azimuth: _Angle, angle: Trigonometric, elevation: _Angle, height: Trigonometric, u: Any, variance: float
) -> Array:
    (cosine, sine), (level, upright) = angle, height
    B, A, D = (_squares(factors, height) for factors in (elevation.B, elevation.A, elevation.D))

    def along(seen: Trigonometric) -> Any:
        B_a, A_a, D_a = (_squares(factors, seen) for factors in (azimuth.B, azimuth.A, azimuth.D))
        return u * (D_a * B + A_a * D) + B_a * B * variance

    across = u * (D * azimuth.across + A * azimuth.across_difference) + B * (azimuth.across * variance)
    difference, product = azimuth.m * elevation.across_difference, azimuth.m * elevation.across
    inclined = level * upright * (u * difference + product * variance)
    xx, yy, xy = along(angle), along(angle[::-1]), cosine * sine * across
    xz, yz = cosine * inclined, sine * inclined
    zz = u * _squares(elevation.D, height[::-1]) + _squares(elevation.B, height[::-1]) * variance
    return _matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def conversion(variances: tuple[float, ...], unbiasing: Unbiasing = "debiased") -> Conversion:
    """The conversion under noises of ``variances``: range (m^2), azimuth, and in space elevation (rad^2).

    ``"debiased"``: the mean bias is subtracted, and the covariance is averaged over where the target may be
    (Lerro & Bar-Shalom 1993; Suchomski 1999). ``"unbiased"``: the position is divided by
    exp(-sigma^2 / 2) for each angle, the covariance accordingly (Longbin et al., IEEE Transactions on
    Aerospace and Electronic Systems 34(3), 1998, eq. 9 and 11). ``"modified"``: mean and covariance of the
    position given its measurement and nothing else (Duan, Han & Li, ibid. 40(4), 2004).

    Raises:
        ModelError: variances or a word that cannot be.
    """
    if unbiasing not in UNBIASINGS:
        words = ", ".join(f'"{word}"' for word in UNBIASINGS)
        raise fault("unbiasing", f" = {shown(unbiasing)}: write one of {words}")
    radial, *angular = variances
    for name, variance in zip(("azimuth", "elevation"), angular, strict=False):
        # Beyond it an angle is as good as unknown.
        if not 0 <= variance <= 10:
            raise fault("R", f": the variance of {name}, {shown(variance)}, is from 0 to 10 rad^2")
    make = _conditional if unbiasing == "modified" else _averaged
    with evaluation(min((v for v in angular if v > 0), default=1.0), 2):
        angles = [make(Decimal(v), Decimal(v) if unbiasing == "unbiased" else Decimal(0)) for v in angular]
        height = Decimal(angular[1]) if len(angular) == 2 else Decimal(0)
        added = 0.0 if unbiasing == "modified" else radial
        circular = _circular(Decimal(radial), Decimal(added), Decimal(angular[0]))
        plane, upright = _factor(Decimal(angular[0]) + height, unbiasing), _factor(height, unbiasing)
    return Conversion(
        factors=(plane, plane, upright) if len(angular) == 2 else (plane, plane),
        range_variance=radial,
        range_added=added,
        azimuth=angles[0],
        elevation=angles[1] if len(angular) == 2 else None,
        circular=circular if len(angular) == 1 else None,
    )


def _circular(radial: Decimal, added: Decimal, variance: Decimal) -> tuple[float, float] | None:
    """The squared range at which across_difference (r^2 + added) + across radial vanishes, in two parts."""
    if not variance:
        return None
    e = (-variance).exp()
    squared = radial * e / (1 - e) - added
    first = float(squared)
    return (first, float(squared - Decimal(first))) if math.isfinite(first) else None


def sight(z: Array) -> Sight:
    """The sight of a measurement (range, bearing) or (range, azimuth, elevation)."""
    return Sight(z[0] * z[0], *_seen(z))


def sight_of(position: Array) -> Sight:
    """The sight of a Cartesian position (2,) or (3,), other than the origin and the vertical above it."""
    x, y = position[:2]
    level = hypot(x, y)
    azimuth = (x / level, y / level)
    if len(position) == 2:
        return Sight(x * x + y * y, azimuth, None)
    z = position[2]
    distance = hypot(level, z)
    return Sight(distance * distance, azimuth, (level / distance, z / distance))


def measured(position: Array) -> Array:
    """(range, bearing) or (range, azimuth, elevation) of a Cartesian position, over elements."""
    x, y = position[:2]
    level = hypot(x, y)
    if len(position) == 2:
        return _vector([level, atan2(y, x)])
    z = position[2]
    return _vector([hypot(level, z), atan2(y, x), atan2(z, level)])


def _seen(z: Array) -> tuple[Trigonometric, Trigonometric | None]:
    return (cos(z[1]), sin(z[1])), (cos(z[2]), sin(z[2])) if len(z) == 3 else None


def _squares(factors: tuple[float, float], angle: Trigonometric) -> Any:
    """The sum of both squares, weighted."""
    cosine, sine = angle
    return cosine * cosine * factors[0] + sine * sine * factors[1]


def _averaged(variance: Decimal, growth: Decimal) -> _Angle:
    """Moments averaged over the true angle given its measurement, of an angle measured about that."""
    e, scale = (-variance).exp(), growth.exp()
    return _Angle(
        B=_pair(scale * (1 + e**4) / 2, scale * (1 - e**4) / 2),
        A=_pair(scale * (e + e**3) / 2, scale * (e - e**3) / 2),
        D=_pair(scale * (1 - e) * (1 - e**3) / 2, scale * (1 - e) * (1 + e**3) / 2),
        across=float(scale * e**4),
        across_difference=-float(scale * e**3 * (1 - e)),
        m=float((growth / 2).exp() * e),
    )


def _conditional(variance: Decimal, growth: Decimal) -> _Angle:
    """Moments of the true angle given its measurement."""
    e, scale = (-variance).exp(), growth.exp()
    return _Angle(
        B=_pair(scale * (1 + e**2) / 2, scale * (1 - e**2) / 2),
        A=_pair(scale * e, Decimal(0)),
        D=_pair(scale * (1 - e) ** 2 / 2, scale * (1 - e**2) / 2),
        across=float(scale * e**2),
        across_difference=-float(scale * e * (1 - e)),
        m=float(((growth - variance) / 2).exp()),
    )


def _factor(variance: Decimal, unbiasing: Unbiasing) -> float:
    match unbiasing:
        case "debiased":
            return float(1 - (-variance).exp() + (-variance / 2).exp())
        case "unbiased":
            return float((variance / 2).exp())
        case "modified":
            return float((-variance / 2).exp())


def _pair(a: Decimal, b: Decimal) -> tuple[float, float]:
    return float(a), float(b)


def _vector(values: list[Any]) -> Array:
    result = np.empty(len(values), object)
    for place, value in enumerate(values):
        result[place] = value
    return result


def _matrix(rows: list[list[Any]]) -> Array:
    result = np.empty((len(rows), len(rows)), object)
    for place in np.ndindex(*result.shape):
        result[place] = rows[place[0]][place[1]]
    return result
