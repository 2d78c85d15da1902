"""The nearly constant turn in a plane, at a turn rate that is known.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
section 11.7.1; Li and Jilkov, Survey of maneuvering target tracking, part I (2003), eq. 61 and 62.
"""

import math
from collections.abc import Sequence
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.checks import fault
from kalmanhdl.model.exact import evaluation, sine_and_cosine
from kalmanhdl.model.motion import (
    Discretisation,
    Motion,
    Order,
    arranged,
    axis_names,
    constant_velocity,
    is_piecewise,
    noises,
    period,
)
from kalmanhdl.validation import as_real, shown

Array = NDArray[np.float64]


def coordinated_turn(
    *,
    T: float,
    turn_rate: float,
    noise: float,
    axes: int | Sequence[str] = 2,
    discretisation: Discretisation = "piecewise",
    order: Order = "axis",
) -> Motion:
    """Position and velocity in two axes, the velocity turning at ``turn_rate`` (rad/s), first axis to second.

    ``noise`` is white acceleration, alike in both axes, as for ``constant_velocity``: ``"piecewise"``
    with its Q; ``"continuous"`` with the integral of the noise along the turn. A turn rate of 0 is
    ``constant_velocity``. Entries are the nearest doubles (for a noise of 1).

    Raises:
        ModelError: T, noise, axes or order that cannot be; more than half a turn in a period.
    """
    T = period(T)
    turn_rate = _rate(turn_rate, T)
    labels = axis_names(axes)
    if len(labels) != 2:
        raise fault("axes", f" are {len(labels)}: a turn is in a plane, so give two")
    if turn_rate == 0:
        return constant_velocity(T=T, noise=noise, axes=axes, discretisation=discretisation, order=order)
    (q,) = noises(noise, 1)
    with evaluation(abs(turn_rate * T), 3):
        rate, period_ = Decimal(turn_rate), Decimal(T)
        s, c = sine_and_cosine(rate * period_)
        F = np.array(_transition(rate, s, c), dtype=np.float64)
        if is_piecewise(discretisation):
            Q = constant_velocity(T=T, noise=noise, axes=labels).Q
        else:
            Q = np.array(_covariance(Decimal(q), period_, rate, s, c), dtype=np.float64)
    return arranged(F, Q, labels, order)


def _transition(rate: Decimal, s: Decimal, c: Decimal) -> list[list[Decimal]]:
    along, across = s / rate, (1 - c) / rate
    zero, one = Decimal(0), Decimal(1)
    return [
        [one, along, zero, -across],
        [zero, c, zero, -s],
        [zero, across, one, along],
        [zero, s, zero, c],
    ]


def _covariance(q: Decimal, T: Decimal, rate: Decimal, s: Decimal, c: Decimal) -> list[list[Decimal]]:
    late = (rate * T - s) / rate**2
    position, near, far = q * 2 * late / rate, q * (1 - c) / rate**2, q * late
    zero, velocity = Decimal(0), q * T
    return [
        [position, near, zero, far],
        [near, velocity, -far, zero],
        [zero, -far, position, near],
        [far, zero, near, velocity],
    ]


def _rate(turn_rate: object, T: float) -> float:
    rate = as_real(turn_rate)
    if rate is None or not math.isfinite(rate):
        raise fault("turn_rate", f" = {shown(turn_rate)}: a finite number of rad/s")
    if abs(rate * T) > math.pi:
        raise fault("turn_rate", f" = {shown(turn_rate)}: at most half a turn in a period of {shown(T)} s")
    return rate
