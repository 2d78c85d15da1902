"""The plane on which a track is drawn, and ellipses of covariance on it."""

import math
import re
from dataclasses import dataclass
from enum import Enum
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.model import Model
from kalmanhdl.report.accuracy import measured_states
from kalmanhdl.report.plots import rate_sources, states_shown

Array = NDArray[np.float64]

# Chi-square with two degrees of freedom stays below this with 95 %: -2 ln 0.05.
_RADIUS_95 = math.sqrt(-2 * math.log(0.05))
_ANGLE = re.compile(r"bearing|azimuth|heading")
_DISTANCE = re.compile(r"range|distance")
_TO_RADIANS = {"rad": 1.0, "": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180}


class Kind(Enum):
    """How a pair of states is drawn: as range and bearing, as coordinates, or one state against time."""

    POLAR = "polar"
    CARTESIAN = "cartesian"
    TIME = "time"


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """What is drawn: the ``states`` and the ``measurements`` that see them, by index; labels of the axes."""

    kind: Kind
    states: tuple[int, ...]
    measurements: tuple[int, ...]
    labels: tuple[str, str]
    radians: float = 1.0


def plane(model: Model) -> Plane:
    """The plane of a model's track.

    Range and bearing by their names, else the first two measured states of one unit that are not rates
    of one another; where no state is measured by itself, the first two of one unit. Else the first
    measured (or first) state against the step.
    """
    seen = [(p, j) for j, p in measured_states(model).items()]
    polar = _polar(model, seen)
    if polar is not None:
        return polar
    rates = _rates(model)
    places = [(p, j) for p, j in seen if p not in rates]
    for k, (first, j) in enumerate(places):
        for second, i in places[k + 1 :]:
            if first != second and model.state_units[first] == model.state_units[second]:
                labels = (label(model, first), label(model, second))
                return Plane(kind=Kind.CARTESIAN, states=(first, second), measurements=(j, i), labels=labels)
    alike = _alike(model) if not seen else None
    if alike is not None:
        labels = (label(model, alike[0]), label(model, alike[1]))
        return Plane(kind=Kind.CARTESIAN, states=alike, measurements=(), labels=labels)
    state, measurements = (seen[0][0], (seen[0][1],)) if seen else (0, ())
    return Plane(
        kind=Kind.TIME, states=(state,), measurements=measurements, labels=("step", label(model, state))
    )


def _rates(model: Model) -> dict[int, int]:
    """The rates of states that are measured by themselves."""
    return rate_sources(model, np.isin(np.arange(model.n), list(measured_states(model).values())))


def _alike(model: Model) -> tuple[int, int] | None:
    """The first two states of one unit that is known."""
    pairs = combinations(enumerate(model.state_units), 2)
    return next(((i, k) for (i, first), (k, second) in pairs if first and first == second), None)


def label(model: Model, state: int) -> str:
    """A state with its unit, in words."""
    return with_unit(model.state_names[state], model.state_units[state])


def with_unit(name: str, unit: str) -> str:
    """A name with its unit in brackets, if it has one."""
    words = name.replace("_", " ")
    return f"{words} ({unit})" if unit else words


def _polar(model: Model, seen: list[tuple[int, int]]) -> Plane | None:
    rates = _rates(model)
    named = [(p, j, model.state_names[p]) for p, j in seen if p not in rates]
    distance = next(((p, j) for p, j, name in named if _DISTANCE.search(name)), None)
    angle = next(((p, j) for p, j, name in named if _ANGLE.search(name)), None)
    if distance is None or angle is None or model.state_units[angle[0]] not in _TO_RADIANS:
        return None
    unit = model.state_units[distance[0]]
    words = model.state_names[angle[0]].replace("_", " ")
    return Plane(
        kind=Kind.POLAR,
        states=(distance[0], angle[0]),
        measurements=(distance[1], angle[1]),
        labels=(with_unit(f"range × sin {words}", unit), with_unit(f"range × cos {words}", unit)),
        radians=_TO_RADIANS[model.state_units[angle[0]]],
    )


def points(shown: Plane, pair: Array) -> Array:
    """Where pairs of states, or of states seen by plots, lie on the plane. Shapes (..., 2) and (..., 2)."""
    if shown.kind is not Kind.POLAR:
        return pair
    r, angle = pair[..., 0], pair[..., 1] * shown.radians
    return np.stack([r * np.sin(angle), r * np.cos(angle)], axis=-1)


def seen_pair(model: Model, shown: Plane, z: Array) -> Array:
    """The states that plots show by themselves. Shapes (..., m) and (..., number of states on the plane)."""
    return np.stack([states_shown(model, z, j) for j in shown.measurements], axis=-1)


def ellipse(shown: Plane, x: Array, P: Array, corners: int = 40) -> Array:
    """The line around the 95 % of one estimate: the covariance carried to the plane by its derivative.

    Shapes: x (n,), P (n, n); result (corners + 1, 2), closed.
    """
    pair, block = x[list(shown.states)], P[np.ix_(shown.states, shown.states)]
    if shown.kind is Kind.POLAR:
        r, angle = pair[0], pair[1] * shown.radians
        sine, cosine = np.sin(angle), np.cos(angle)
        J = np.array([[sine, r * cosine * shown.radians], [cosine, -r * sine * shown.radians]])
        block = J @ block @ J.T
    values, vectors = np.linalg.eigh(block)
    turn = np.linspace(0, 2 * np.pi, corners + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    around = vectors @ (np.sqrt(np.maximum(values, 0))[:, None] * circle)
    return np.asarray(points(shown, pair) + _RADIUS_95 * around.T)
