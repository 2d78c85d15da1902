"""Motion models: constant velocity and constant acceleration along independent axes.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001),
sections 6.2 (continuous white noise) and 6.3 (noise constant over a period).
Others: ``model.singer``, ``model.turn``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.checks import fault
from kalmanhdl.validation import as_integer, as_real, as_tuple, names_problem, shown

Array = NDArray[np.float64]

Discretisation = Literal["piecewise", "continuous"]
DISCRETISATIONS = ("piecewise", "continuous")
DEFAULT_AXES = ("x", "y", "z")

Order = Literal["axis", "derivative"]
ORDERS = ("axis", "derivative")

_SUFFIXES = ("", "_rate", "_acceleration")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """F and Q (n, n) of a motion, H (axes, n) that measures the positions, and the names of the states."""

    F: Array
    Q: Array
    H: Array
    state_names: tuple[str, ...]
    axes: tuple[str, ...]


def constant_velocity(
    *,
    T: float,
    noise: float | Sequence[float],
    axes: int | Sequence[str] = 1,
    discretisation: Discretisation = "piecewise",
    order: Order = "axis",
) -> Motion:
    """Position and velocity per axis, driven by white acceleration, with a period of T seconds.

    ``"piecewise"``: an acceleration of standard deviation ``noise`` (m/s^2), constant over each period;
    Q = noise^2 G G' with G = (T^2/2, T) (section 6.3.2). ``"continuous"``: white acceleration of spectral
    density ``noise`` (m^2/s^3); Q = noise [[T^3/3, T^2/2], [T^2/2, T]] (section 6.2.2). ``noise`` may be
    one number, or one per axis; ``axes`` a number from 1 to 3, or one to three names. States stand
    ``"axis"`` by axis (x, x_rate, y, y_rate), or by ``"derivative"`` (x, y, x_rate, y_rate).

    Raises:
        ModelError: T, noise or axes that cannot be.
    """
    T = period(T)
    F = np.array([[1, T], [0, 1]])
    gain = np.array([T**2 / 2, T])
    density = np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    return _driven(F, gain, density, noise, axes, discretisation, order)


def constant_acceleration(
    *,
    T: float,
    noise: float | Sequence[float],
    axes: int | Sequence[str] = 1,
    discretisation: Discretisation = "piecewise",
    order: Order = "axis",
) -> Motion:
    """Position, velocity and acceleration per axis, with a period of T seconds.

    ``"piecewise"``: the acceleration steps by ``noise`` (standard deviation, m/s^2) each period;
    Q = noise^2 G G' with G = (T^2/2, T, 1) (section 6.3.3). ``"continuous"``: white jerk of spectral
    density ``noise`` (m^2/s^5); Q = noise [[T^5/20, T^4/8, T^3/6], [., T^3/3, T^2/2], [., ., T]]
    (section 6.2.3). Otherwise as ``constant_velocity``.
    """
    T = period(T)
    F = np.array([[1, T, T**2 / 2], [0, 1, T], [0, 0, 1]])
    gain = np.array([T**2 / 2, T, 1])
    density = np.array(
        [[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]]
    )
    return _driven(F, gain, density, noise, axes, discretisation, order)


def _driven(
    F: Array,
    gain: Array,
    density: Array,
    noise: float | Sequence[float],
    axes: int | Sequence[str],
    discretisation: Discretisation,
    order: Order,
) -> Motion:
    labels = axis_names(axes)
    numbers = noises(noise, len(labels))
    if is_piecewise(discretisation):
        blocks = [q**2 * np.outer(gain, gain) for q in numbers]
    else:
        blocks = [q * density for q in numbers]
    return along_axes(F, blocks, labels, order)


def is_piecewise(discretisation: Discretisation) -> bool:
    """Whether the noise is constant over a period. Raises ModelError where that is no word for it."""
    if not isinstance(discretisation, str) or discretisation not in DISCRETISATIONS:
        raise fault("discretisation", f" = {shown(discretisation)}: write {_alternatives(DISCRETISATIONS)}")
    return discretisation == "piecewise"


def along_axes(F: Array, Q: Sequence[Array], labels: tuple[str, ...], order: Order) -> Motion:
    """The motion along independent axes, each by F (k, k), with noises Q (k, k) of their own.

    Raises:
        ModelError: an order that is none.
    """
    size = len(F)
    identity: Array = np.eye(len(labels))
    whole = np.zeros((size * len(labels),) * 2)
    for axis, block in enumerate(Q):
        whole[axis * size : (axis + 1) * size, axis * size : (axis + 1) * size] = block
    return arranged(np.asarray(np.kron(identity, F), dtype=np.float64), whole, labels, order)


def arranged(F: Array, Q: Array, labels: tuple[str, ...], order: Order) -> Motion:
    """The motion whose F and Q are given axis by axis, with its states in the order asked for.

    Raises:
        ModelError: an order that is none.
    """
    if not isinstance(order, str) or order not in ORDERS:
        raise fault("order", f" = {shown(order)}: write {_alternatives(ORDERS)}")
    size = len(F) // len(labels)
    names = [label + suffix for label in labels for suffix in _SUFFIXES[:size]]
    places = np.arange(len(F))
    if order == "derivative":
        places = places.reshape(len(labels), size).T.ravel()
    return Motion(
        F=F[np.ix_(places, places)],
        Q=Q[np.ix_(places, places)],
        H=np.asarray(np.kron(np.eye(len(labels)), np.eye(1, size)), dtype=np.float64)[:, places],
        state_names=tuple(names[place] for place in places),
        axes=labels,
    )


def _alternatives(words: Sequence[str]) -> str:
    return " or ".join(f'"{word}"' for word in words)


def period(T: float) -> float:
    """A period T (s) that can be one. Raises ModelError."""
    # Its fifth power must stay finite.
    seconds = as_real(T)
    if seconds is None or not 1e-30 < seconds < 1e30:
        raise fault("T", f" = {shown(T)}: a period is a positive number of seconds")
    return seconds


def axis_names(axes: int | Sequence[str]) -> tuple[str, ...]:
    """The names of the axes. Raises ModelError."""
    count, names = as_integer(axes), as_tuple(axes)
    if count is not None and 1 <= count <= len(DEFAULT_AXES):
        return DEFAULT_AXES[:count]
    if names is not None and 1 <= len(names) <= len(DEFAULT_AXES):
        problem = names_problem(names)
        if problem is None:
            return tuple(map(str, names))
        raise fault("axes", f": {problem}")
    raise fault("axes", f" = {shown(axes)}: a number from 1 to 3, or a list of one to three names")


def noises(noise: float | Sequence[float], count: int) -> tuple[float, ...]:
    """One noise an axis. Raises ModelError."""
    given = as_tuple(noise)
    if given is None:
        given = (noise,) * count
    if len(given) != count:
        raise fault("noise", f" has {len(given)} numbers: one, or one for each of the {count} axes")
    numbers = tuple(map(as_real, given))
    for number, each in zip(numbers, given, strict=True):
        if number is None or not 0 <= number < math.inf:
            raise fault("noise", f" = {shown(each)}: a finite number of 0 or more")
    return tuple(number for number in numbers if number is not None)
