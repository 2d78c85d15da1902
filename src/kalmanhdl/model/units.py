"""Units: what one unit of each state, measurement and control stands for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Units:
    """The real value of one unit: x = state * x', z = measurement * z', u = control * u'.

    The covariance of every decoupled component is divided by a number as well, which leaves the gain
    alone: P[i,j] = state[i] state[j] covariance[i] P'[i,j]. It is the general form of the
    normalisation by sigma^2 of lee1997, eq. 14. Shapes: (n,), (m,), (p,), (n,).
    """

    state: Array
    measurement: Array
    control: Array
    covariance: Array

    def covariances(self) -> Array:
        """The real value of one unit of every entry of P. Shape (n, n)."""
        return np.asarray(np.outer(self.state, self.state) * self.covariance[:, None])

    def of_measured(self, dependence: NDArray[np.bool_]) -> Array:
        """The number by which the covariance of each measurement's component is divided. Shape (m,).

        ``dependence`` (m, n) tells which states a measurement depends on.
        """
        seen = [np.flatnonzero(row) for row in dependence]
        return np.array([self.covariance[row[0]] if len(row) else 1.0 for row in seen])


def unscaled(n: int, m: int, p: int) -> Units:
    """The units of the model itself."""
    return Units(state=np.ones(n), measurement=np.ones(m), control=np.ones(p), covariance=np.ones(n))


def divided(covariance: Array, unit: Array, divisor: Array) -> Array:
    """A covariance (k, k) in units (k,) of its variables, divided by numbers (k,) as well."""
    spread = np.sqrt(np.outer(divisor, divisor))
    # The square root of a square need not be exact; on the diagonal blocks the unit is the number itself.
    equal = np.equal.outer(divisor, divisor)
    spread[equal] = np.broadcast_to(divisor, spread.shape)[equal]
    return np.asarray(covariance / np.outer(unit, unit) / spread)
