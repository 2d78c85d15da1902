"""The covariance filter whose inverse is a Taylor expansion about a covariance known beforehand."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from kalmanhdl.algorithm import steady_state
from kalmanhdl.algorithm.covariance import corrected, covariance_filter, innovation
from kalmanhdl.algorithm.filter import Algorithm, Belief, Correction, Filter, Given, as_linear
from kalmanhdl.algorithm.gain import Gain, normalised_innovation_squared
from kalmanhdl.algorithm.joseph import joseph_covariance
from kalmanhdl.graph.linear_algebra import blocks, symmetric
from kalmanhdl.graph.signal import Array, Condition, both, named, select
from kalmanhdl.model.checks import reals
from kalmanhdl.model.model import Array as Numbers
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.validation import (
    InvalidModelValueError,
    InvalidValueError,
    KalmanhdlWarning,
    integer,
    nearest,
    shown,
)

About = Literal["identity", "initial", "steady_state"]
Point = tuple[tuple[float, ...], ...]
POINTS: tuple[About, ...] = ("identity", "initial", "steady_state")

MAX_NEWTON = 8
# Every combination of valid components has an inverse of its own.
MAX_BLOCK = 6
# So many misses in a row must a point bear that is recommended: what formats are made for if nothing is said.
_MISSED = 5
# So many covariances are added up at most to cover all others.
_COVERING = 32
# So many updates show whether an expansion converges on the way to the steady state.
_WATCHED = 1000


@dataclass(frozen=True, slots=True)
class Taylor(Algorithm):
    """S^-1 by its expansion of first order, X0 - X0 (S - S0) X0, about a covariance P0, liu2007 eq. 14.

    X0 is the inverse of S0 = H P0 H' + R, and a constant. ``about`` says which P0: "identity" as liu2007
    eq. 12 to 15 have it, "initial" that of a track's first update, "steady_state" the a priori covariance
    that tracks come to, or an (n, n) matrix in the units of the model. ``newton`` steps X := X (2 I - S X)
    (Schulz 1933) may follow, each of which squares what is left: with E = I - S X0, the inverse X
    has I - S X = E^2, and E^(2^(newton + 1)) after them; see ``gain_error``. The covariance is
    Joseph's, liu2007 eq. 4, which is right for any gain. ``nis`` rests on the approximate inverse.

    Where a component is missed, the expansion is that of the valid ones: a constant X0 for each combination
    of them, which a block of at most six correlated innovations can have.

    It warns where the expansion does not converge: S > 2 S0 in some direction turns a gain round, and the
    filter diverges. Take "initial" where covariances fall, "steady_state" where they grow or the start is
    near it; where measurements are missed, which raises S, a covariance above half of what that makes of it.
    A point too high only makes gains too small, which ``newton`` repairs.

    No reciprocals. Multiplications of signals for dense H: n m^2 for the gain, 2 n^3 + n^2 m for the
    covariance, and 2 m^3 for the expansion and for each of the ``newton`` steps; a diagonal S0 takes the
    expansion's by constants. Choose it where the covariance stays near one value and a reciprocal is too
    long for the loop or too large.
    """

    about: About | Point = "steady_state"
    newton: int = 0
    kind: ClassVar[str] = "taylor"

    def __post_init__(self) -> None:
        object.__setattr__(self, "about", _point(self.about))
        object.__setattr__(self, "newton", integer("algorithm", "newton", self.newton, 0, MAX_NEWTON))

    def __call__(self, model: Model) -> Filter:
        """The filter of a linear model. Warns with KalmanhdlWarning where the expansion does not converge."""
        linear = as_linear(model, self)
        P0 = self.point(linear)
        _warn_of_divergence(linear, P0, self.about)
        return _Expanded(_rows(P0), self.newton)(linear)

    def in_units(self, model: Model, covariance: Numbers) -> Algorithm:
        """The same expansion, its point in the units of the hardware."""
        return _Expanded(_rows(self.point(as_linear(model, self)) / covariance), self.newton)

    def trouble(self, model: Model, coast: int) -> str:
        """Misses raise S: whether the expansion converges when ``coast`` of them come in a row, for ever.

        Nothing, where it does not converge without them, which calling it warns of.
        """
        linear = as_linear(model, self)
        P0 = self.point(linear)
        radius = _greatest_radius(linear, P0, _path(linear, coast))
        if radius < 1.0 or _greatest_radius(linear, P0, _path(linear, 0)) >= 1.0:
            return ""
        borne = [k for k in range(coast) if _greatest_radius(linear, P0, _path(linear, k)) < 1.0]
        fewer = f", or allow fewer misses: [numerics] coast = {borne[-1]}" if borne else ""
        return (
            f"[algorithm] about = {_named(self.about)} does not converge when measurements are missed "
            f"{coast} times in a row, as [numerics] coast = {coast} says: the spectral radius of I - S S0^-1 "
            f"comes to {radius:.3g}, which must stay below 1: {_remedy(linear, coast)}{fewer}"
        )

    def point(self, model: LinearModel) -> Numbers:
        """The covariance about which the expansion is made. Shape (n, n)."""
        match self.about:
            case "identity":
                return np.eye(model.n)
            case "initial":
                return steady_state.first_prior(model)
            case "steady_state":
                return steady_state.steady_prior(model)
            case matrix:
                return _checked(np.array(matrix), model)


def gain_error(model: LinearModel, P0: Numbers, P: Numbers, newton: int = 0) -> float:
    """How far the gain at P can be from the optimal one, when the expansion is about P0: a relative bound.

    With L L' = S0 the difference is K E^q, q = 2^(newton + 1), so that in the spectral norm
    |(K~ - K) L| <= r^q |K L|, where r is the spectral radius of E = I - S S0^-1. Returns r^q. It holds for
    every combination of valid components: a part of S and S0 has no eigenvalues beyond those of the whole.
    """
    return float(spectral_radius(model, P0, P) ** (2 ** (newton + 1)))


def spectral_radius(model: LinearModel, P0: Numbers, P: Numbers) -> float:
    """The spectral radius of I - S S0^-1; below 1 the expansion about P0 converges at P."""
    return _greatest_radius(model, P0, [P])


@dataclass(frozen=True, slots=True)
class _Expanded(Algorithm):
    """The expansion about a covariance in the units of the model that it is called with."""

    point: Point
    newton: int
    kind: ClassVar[str] = Taylor.kind

    def __call__(self, model: Model) -> Filter:
        linear = as_linear(model, self)
        S0 = steady_state.innovation_covariance(linear, np.array(self.point))
        S0[np.abs(S0) <= 8 * np.finfo(np.float64).eps * np.sqrt(np.outer(np.diag(S0), np.diag(S0)))] = 0.0
        return covariance_filter(linear, lambda prior, given: _update(linear, S0, self.newton, prior, given))


def _update(model: LinearModel, S0: Numbers, newton: int, prior: Belief, given: Given) -> Correction:
    y = innovation(model, prior.x, given)
    gain = _approximate_gain(model, S0, newton, prior, given.valid)
    P = joseph_covariance(model, prior, gain.K)
    return corrected(prior.x + gain.K @ y, P, y, normalised_innovation_squared(model, gain, y))


def _approximate_gain(
    model: LinearModel, S0: Numbers, newton: int, prior: Belief, valid: tuple[Condition, ...]
) -> Gain:
    """K = P H' X, liu2007 eq. 15."""
    H, R = model.H.astype(object), model.R.astype(object)
    PHt = named("update: PHt", prior.P @ H.T)
    S = named("update: S", symmetric(H @ PHt + R))
    coupled = S.copy()
    coupled[S0 != 0.0] = 1.0
    parts = blocks(coupled)
    X = np.zeros_like(S)
    for part in parts:
        place = np.ix_(part, part)
        X[place] = _expansion(S[place], S0[place], [valid[j] for j in part])
    for _ in range(newton):
        X = _nearer(X, S)
    X = named("update: Si", X)
    return Gain(PHt, named("update: K", PHt @ X), X, parts)


def _expansion(S: Array, S0: Numbers, valid: Sequence[Condition]) -> Array:
    """2 X0 - X0 S X0 over the valid components of a block, zero in rows and columns of the others."""
    if not np.any(S0 - np.diag(np.diag(S0))):
        return _of_uncorrelated(S, np.diag(S0), valid)
    if len(S) > MAX_BLOCK:
        most = f"at most {MAX_BLOCK} correlated innovations, here are {len(S)}: "
        problem = f' = "{Taylor.kind}" expands {most}'
        raise InvalidModelValueError("algorithm", "kind", problem + 'use "sequential"')
    X0 = named("update: X0", _inverse_of_valid(S0, valid))
    return _nearer(X0, S)


def _nearer(X: Array, S: Array) -> Array:
    """2 X - X S X: the first order about the inverse of X, liu2007 eq. 14, and then each step of Newton's."""
    return symmetric(2.0 * X - X @ (S @ X))


def _of_uncorrelated(S: Array, diagonal: Numbers, valid: Sequence[Condition]) -> Array:
    """The expansion about a diagonal S0, each entry of S by a constant."""
    count = len(S)
    X = np.zeros((count, count), object)
    for a, b in np.ndindex(count, count):
        entry = (2.0 / diagonal[a] if a == b else 0.0) - S[a, b] * (1.0 / (diagonal[a] * diagonal[b]))
        X[a, b] = select(both(valid[a], valid[b]), entry, 0.0)
    return X


def _inverse_of_valid(S0: Numbers, valid: Sequence[Condition]) -> Array:
    """The inverse of the part of S0 that belongs to the valid components; zero elsewhere."""
    count = len(S0)
    inverses = {}
    for used in _subsets(count):
        place = np.ix_(used, used)
        inverses[used] = np.zeros((count, count))
        inverses[used][place] = np.linalg.inv(S0[place])
    X0 = np.zeros((count, count), object)
    for a in range(count):
        for b in range(a, count):
            entries = {used: float(inverse[a, b]) for used, inverse in inverses.items()}
            X0[a, b] = X0[b, a] = _chosen(entries, valid, ())
    return X0


def _subsets(count: int) -> list[tuple[int, ...]]:
    return [tuple(i for i in range(count) if bits >> i & 1) for bits in range(1 << count)]


def _chosen(values: dict[tuple[int, ...], Any], valid: Sequence[Condition], used: tuple[int, ...]) -> Any:
    """The value that belongs to the components that are valid; ``used`` are those asked so far."""
    if not valid:
        return values[used]
    *before, last = valid
    return select(
        last,
        _chosen(values, before, (len(before), *used)),
        _chosen(values, before, used),
    )


def _warn_of_divergence(model: LinearModel, P0: Numbers, about: About | Point) -> None:
    radius = _greatest_radius(model, P0, _path(model, 0))
    if radius < 1.0:
        return
    warnings.warn(
        f"[algorithm] about = {_named(about)} does not converge for this model: on its way from the start "
        f"to the steady state the spectral radius of I - S S0^-1 comes to {radius:.3g}, which must stay "
        f"below 1: {_remedy(model, _MISSED)}",
        KalmanhdlWarning,
        stacklevel=3,
    )


def _named(about: About | Point) -> str:
    return f'"{about}"' if isinstance(about, str) else "this matrix"


def _path(model: LinearModel, coast: int) -> Sequence[Numbers]:
    """A priori covariances on the way to the steady state, after no miss and after ``coast`` in a row.

    Also where so many come between any two updates.
    """
    straight = steady_state.approach(model, _WATCHED)
    if not coast:
        return straight
    path, P = [*straight], straight[0]
    for before in straight:
        for seldom in (before, P):
            missed = seldom
            for _ in range(coast):
                missed = steady_state.predicted(model, missed)
            path.append(missed)
        P = steady_state.predicted(model, steady_state.corrected(model, missed))
    return path


def _remedy(model: LinearModel, coast: int) -> str:
    """A point of expansion that converges, with so many misses in a row."""
    path = _path(model, coast)
    for name in ("initial", "steady_state"):
        if _greatest_radius(model, Taylor(about=name).point(model), path) < 1.0:
            return f'write about = "{name}"'
    # Above half of every covariance on the way there is nothing to turn round.
    covering = path[0]
    for _ in range(_COVERING):
        printed = np.array([[float(f"{entry:.3g}") for entry in row] for row in covering])
        radii = _radii(model, printed, path) if _is_covariance(printed) else None
        if radii is not None and radii.max() < 1.0:
            rows = ", ".join("[" + ", ".join(f"{entry:.3g}" for entry in row) + "]" for row in printed)
            return f"write about = [{rows}]"
        covering = covering + path[int(np.argmax(_radii(model, covering, path)))]
    return 'choose "conventional"'


def _is_covariance(P: Numbers) -> bool:
    return bool(np.linalg.eigvalsh(P)[0] >= -1e-9 * np.abs(P).max())


def _greatest_radius(model: LinearModel, P0: Numbers, path: Sequence[Numbers]) -> float:
    return float(_radii(model, P0, path).max())


def _radii(model: LinearModel, P0: Numbers, path: Sequence[Numbers]) -> Numbers:
    """``spectral_radius`` at each covariance of a path. Shape (len(path),)."""
    L = np.linalg.cholesky(steady_state.innovation_covariance(model, P0))
    S = model.H @ np.stack(path) @ model.H.T + model.R
    half = np.linalg.solve(L, S).swapaxes(1, 2)
    M = np.linalg.solve(L, half)
    return np.asarray(np.abs(1.0 - np.linalg.eigvalsh((M + M.swapaxes(1, 2)) / 2)).max(axis=1))


def _rows(matrix: Numbers) -> Point:
    return tuple(tuple(map(float, row)) for row in matrix)


def _point(about: object) -> About | Point:
    if isinstance(about, str):
        for name in POINTS:
            if about == name:
                return name
        hint = nearest(about, POINTS)
        raise InvalidValueError("algorithm", "about", f" = {shown(about)} is unknown: {hint}")
    try:
        return _rows(reals(about))  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        problem = f" = {shown(about)}: write one of {', '.join(POINTS)}, or a covariance [[...], ...]"
        raise InvalidValueError("algorithm", "about", problem) from None


def _checked(P0: Numbers, model: LinearModel) -> Numbers:
    """A point that the user gave. Raises ModelError where it is no covariance of the model's states."""
    if P0.shape != (model.n, model.n):
        size = " x ".join(map(str, P0.shape))
        raise InvalidModelValueError("algorithm", "about", f" is {size}: {model.n} x {model.n}, as F")
    symmetrical = np.isfinite(P0).all() and np.allclose(P0, P0.T, rtol=1e-9, atol=0.0)
    if not symmetrical or not _is_covariance(P0):
        problem = " is no covariance: make it symmetric and positive semidefinite"
        raise InvalidModelValueError("algorithm", "about", problem)
    return (P0 + P0.T) / 2
