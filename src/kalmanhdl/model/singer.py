"""The Singer model: an acceleration that forgets itself within a time constant.

Source: Singer, Estimating optimal tracking filter performance for manned maneuvering targets, IEEE
Transactions on Aerospace and Electronic Systems 6(4), 1970. The closed forms cancel as the fifth power of
T / tau; they are evaluated in decimal with the digits that this costs, and rounded once.
"""

from collections.abc import Sequence
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.checks import fault
from kalmanhdl.model.exact import evaluation
from kalmanhdl.model.motion import (
    Discretisation,
    Motion,
    Order,
    along_axes,
    axis_names,
    is_piecewise,
    noises,
    period,
)
from kalmanhdl.validation import as_real, shown

Array = NDArray[np.float64]


def singer(
    *,
    T: float,
    tau: float,
    noise: float | Sequence[float],
    axes: int | Sequence[str] = 1,
    discretisation: Discretisation = "continuous",
    order: Order = "axis",
) -> Motion:
    """Position, velocity and acceleration a per axis, da/dt = -a / tau + w, with a period of T seconds.

    ``"continuous"``: w is white, and ``noise`` the standard deviation (m/s^2) that the acceleration has
    in the long run. ``"piecewise"``: w is constant over each period, with standard deviation ``noise``
    (m/s^3); this is Gamma Q Gamma' of wu2012, eq. 4 and 10, where noise is gamma sqrt(Q) and tau is
    1 / alpha. Every entry of F, and of Q for a noise of 1, is the nearest double. Otherwise as
    ``constant_velocity``.

    Raises:
        ModelError: T, tau, noise, axes or order that cannot be.
    """
    T, tau = period(T), _time_constant(tau)
    labels = axis_names(axes)
    deviations = [Decimal(q) for q in noises(noise, len(labels))]
    piecewise = is_piecewise(discretisation)
    with evaluation(T / tau, 5):
        F = _transition(Decimal(T), Decimal(tau))
        unit = _held(Decimal(T), Decimal(tau)) if piecewise else _white(Decimal(T), Decimal(tau))
        blocks = [_rounded([[q * q * entry for entry in row] for row in unit]) for q in deviations]
        return along_axes(_rounded(F), blocks, labels, order)


def _transition(T: Decimal, tau: Decimal) -> list[list[Decimal]]:
    x = T / tau
    kept = (-x).exp()
    zero, one = Decimal(0), Decimal(1)
    return [[one, T, tau**2 * (x - 1 + kept)], [zero, one, tau * (1 - kept)], [zero, zero, kept]]


def _white(T: Decimal, tau: Decimal) -> list[list[Decimal]]:
    """The covariance that white noise leaves, for an acceleration of variance 1 in the long run."""
    x = T / tau
    e, e2 = (-x).exp(), (-2 * x).exp()
    position = tau**4 * (1 - e2 + 2 * x + 2 * x**3 / 3 - 2 * x**2 - 4 * x * e)
    velocity = tau**2 * (4 * e - 3 - e2 + 2 * x)
    both = tau**3 * (e2 + 1 - 2 * e + 2 * x * e - 2 * x + x**2)
    far, near = tau**2 * (1 - e2 - 2 * x * e), tau * (e2 + 1 - 2 * e)
    return [[position, both, far], [both, velocity, near], [far, near, 1 - e2]]


def _held(T: Decimal, tau: Decimal) -> list[list[Decimal]]:
    """G G' of the gain G of a w that is constant over the period."""
    x = T / tau
    lost = 1 - (-x).exp()
    gain = [tau**3 * (x**2 / 2 - x + lost), tau**2 * (x - lost), tau * lost]
    return [[a * b for b in gain] for a in gain]


def _rounded(matrix: list[list[Decimal]]) -> Array:
    return np.array([[float(entry) for entry in row] for row in matrix])


def _time_constant(tau: float) -> float:
    seconds = as_real(tau)
    if seconds is None or not 1e-30 < seconds < 1e30:
        raise fault("tau", f" = {shown(tau)}: a time constant is a positive number of seconds")
    return seconds
