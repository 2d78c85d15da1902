"""Linear time-invariant state-space models and how a track starts.

x(k) = F x(k-1) + B u(k) + offset + w,   w ~ N(0, Q)
z(k) = H x(k) + measurement_offset + v,  v ~ N(0, R)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Initial:
    """How the command ``initialise`` starts a track from measurement z and the state x kept before.

        x := x0 + from_measurement z + from_state x,   P := P0

    A k-point initialisation (``points = k``) is k such commands in a row: what the earlier ones leave in
    the state, the last one needs. With ``before_update`` the result is the a priori belief for the row
    of the command, which its valid measurements then update; otherwise it is that row's estimate.

    Shapes: x0 (n,), from_measurement (n, m), from_state (n, n), P (n, n).
    """

    x: Array
    from_measurement: Array
    from_state: Array
    P: Array
    points: int
    before_update: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearModel:
    """What is estimated. Shapes: F (n, n), H (m, n), Q (n, n), R (m, m), B (n, p), p may be 0."""

    F: Array
    H: Array
    Q: Array
    R: Array
    initial: Initial
    B: Array
    offset: Array
    measurement_offset: Array
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    measurement_names: tuple[str, ...]
    control_names: tuple[str, ...]
    # Declared limits, real units, per measurement (m, 2), or None: formats then rest on simulation.
    measurement_range: Array | None = None

    @property
    def n(self) -> int:
        """Number of states."""
        return self.F.shape[0]

    @property
    def m(self) -> int:
        """Number of measurements."""
        return self.H.shape[0]

    @property
    def p(self) -> int:
        """Number of controls."""
        return self.B.shape[1]
