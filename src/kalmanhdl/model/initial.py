"""Rules by which a track starts, each a function from the model's matrices to an ``Initial``."""

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.model import checks
from kalmanhdl.model.state_space import Dynamics, Initial, InitialRule
from kalmanhdl.validation import shown

Array = NDArray[np.float64]

At = Literal["first", "before_first"]


def given(x: ArrayLike, P: ArrayLike, *, at: At = "first") -> InitialRule:
    """A track starts from a belief x (n,), P (n, n).

    At ``"first"`` it is the a priori belief for the first row, whose own measurements then update it (the
    convention of pykalman and statsmodels). At ``"before_first"`` it belongs one step earlier, and the
    prediction to the first row, by that row's controls, is part of the start (the convention of filterpy).
    """

    def start(dynamics: Dynamics) -> Initial:
        n, m = dynamics.F.shape[0], dynamics.H.shape[0]
        mean = checks.array("initial.x", x, (n,), f"x has {n} numbers, one a state")
        covariance = checks.array("initial.P", P, (n, n), f"P is {n} x {n}, as F")
        covariance = checks.covariance("initial.P", covariance, definite=False)
        if not isinstance(at, str) or at not in ("first", "before_first"):
            raise checks.fault("initial.at", f' = {shown(at)}: write "first" or "before_first"')
        if at == "before_first":
            with np.errstate(all="ignore"):
                mean = dynamics.F @ mean + dynamics.offset
                covariance = dynamics.F @ covariance @ dynamics.F.T + dynamics.Q
        return Initial(
            x=mean,
            from_measurement=np.zeros((n, m)),
            from_state=np.zeros((n, n)),
            P=covariance,
            points=1,
            before_update=True,
            from_control=dynamics.B if at == "before_first" and dynamics.B.shape[1] else None,
        )

    return start


def two_point(*, P: ArrayLike | None = None) -> InitialRule:
    """A track starts from its first two rows: positions from the second, rates from the difference.

    The general form of lee1997, eq. 11-13. With z_j = h x_i + d + v, x_i(k) = a x_i(k-1) + T x_l(k-1) and
    x_l(k) = c x_l(k-1), offsets aside,

        x_i = (z_j - d) / h,   x_l = c (x_i - a previous x_i) / T,

    and the errors are e_i = -v2 / h and e_l = w_l - c w_i / T - c (v2 - a v1) / (h T), whose covariance
    under Q and R is P unless one is given. Units: those of the states.

    Raises:
        ModelError: (by the rule) a state that is neither measured alone nor the rate of such a state.
    """

    def start(dynamics: Dynamics) -> Initial:
        n, m = dynamics.F.shape[0], dynamics.H.shape[0]
        pairs = _measured(dynamics)
        x, from_measurement, from_state = np.zeros(n), np.zeros((n, m)), np.zeros((n, n))
        # The error is from_w w + from_v2 v2 + from_v1 v1.
        from_w, from_v1, from_v2 = np.zeros((n, n)), np.zeros((n, m)), np.zeros((n, m))
        with np.errstate(all="ignore"):
            for pair in pairs:
                i, j = pair.state, pair.row
                inverse_h = 1 / dynamics.H[j, i]
                d = dynamics.measurement_offset[j]
                x[i] = -d * inverse_h
                from_measurement[i, j] = inverse_h
                from_v2[i, j] = -inverse_h
                if pair.rate is None:
                    continue
                k = pair.rate
                a, per_T = dynamics.F[i, i], dynamics.F[k, k] / dynamics.F[i, k]
                x[k] = (-d * inverse_h - dynamics.offset[i]) * per_T + dynamics.offset[k]
                from_measurement[k, j] = inverse_h * per_T
                from_state[k, i] = -a * per_T
                from_w[k, k], from_w[k, i] = 1, -per_T
                from_v2[k, j], from_v1[k, j] = -inverse_h * per_T, a * inverse_h * per_T
            covariance = from_w @ dynamics.Q @ from_w.T
        return Initial(
            x=x + 0.0,  # no negative zeros
            from_measurement=from_measurement,
            from_state=from_state,
            P=covariance if P is None else _given(P, n),
            points=2,
            before_update=False,
            from_noise=np.hstack([from_v2, from_v1]) if P is None else None,
        )

    return start


def three_point(*, P: ArrayLike | None = None) -> InitialRule:
    """A track starts from its first three rows: the one path of the motion that passes through them.

    Of a noiseless path, x(k-1) = F^-1 (x(k) - b) with offset b, and z = H x + d. So with L = H F^-1 and
    M = H F^-2 the rows z3, z2, z1 determine x(3) where the square matrix O of H, L, M has an inverse, with
    column blocks G3, G2, G1:

        x(3) = G3 (z3 - d) + G2 (z2 - d + L b) + G1 (z1 - d + L b + M b).

    For constant acceleration these are the differences z3, (3 z3 - 4 z2 + z1) / 2 T and
    (z3 - 2 z2 + z1) / T^2. A path found so keeps the rows that it passed through, z2 = H x(2) + d and
    z1 = L (x(2) - b) + d, so the state is all that one command needs of those before it:

        x := G3 (z - d) + (G2 H + G1 L) x + (G2 L + G1 M) b.

    The error under Q and R is (G2 L + G1 M) w3 + G1 L w2 - G3 v3 - G2 v2 - G1 v1, and P its covariance
    unless one is given (wu2012, section 2.2, has the host do this, and gives no formulas).

    Raises:
        ModelError: (by the rule) not three states for each measurement, an O without inverse, controls.
    """

    def start(dynamics: Dynamics) -> Initial:
        n, m = dynamics.F.shape[0], dynamics.H.shape[0]
        if n != 3 * m:
            raise _unsuited(f"{n} states are not three for each of {m} measurements", "three_point")
        if dynamics.B.any():
            raise _unsuited("controls move the states", "three_point")
        H = _fractions(dynamics.H)
        back = _inverse(_fractions(dynamics.F), "F has no inverse")
        L = H @ back
        M = L @ back
        G = _inverse(np.vstack([H, L, M]), "three rows do not determine the states")
        G3, G2, G1 = G[:, :m], G[:, m : 2 * m], G[:, 2 * m :]
        from_w3, from_w2 = _floats(G2 @ L + G1 @ M), _floats(G1 @ L)
        with np.errstate(all="ignore"):
            covariance = from_w3 @ dynamics.Q @ from_w3.T + from_w2 @ dynamics.Q @ from_w2.T
            x = from_w3 @ dynamics.offset - _floats(G3) @ dynamics.measurement_offset
        return Initial(
            x=x + 0.0,  # no negative zeros
            from_measurement=_floats(G3),
            from_state=_floats(G2 @ H + G1 @ L),
            P=covariance if P is None else _given(P, n),
            points=3,
            before_update=False,
            from_noise=_floats(G) if P is None else None,
        )

    return start


def _given(P: ArrayLike, n: int) -> Array:
    return checks.array("initial.P", P, (n, n), f"P is {n} x {n}, as F")


def _fractions(matrix: Array) -> NDArray[np.object_]:
    # What is zero must come out as zero: every other number costs a multiplication.
    exact = np.empty(matrix.shape, object)
    for place in np.ndindex(*matrix.shape):
        exact[place] = Fraction(float(matrix[place]))
    return exact


def _floats(exact: NDArray[np.object_]) -> Array:
    return np.array([[_float(entry) for entry in row] for row in exact])


def _float(exact: Fraction) -> float:
    try:
        return float(exact)
    except OverflowError:
        return math.inf


def _inverse(matrix: NDArray[np.object_], problem: str) -> NDArray[np.object_]:
    """The exact inverse, by elimination that leaves zeros alone."""
    n = len(matrix)
    work = np.hstack([matrix, _fractions(np.eye(n))])
    for j in range(n):
        pivot = next((i for i in range(j, n) if work[i, j]), None)
        if pivot is None:
            raise _unsuited(problem, "three_point")
        work[[j, pivot]] = work[[pivot, j]]
        work[j] = work[j] / work[j, j]
        for i in range(n):
            if i != j and work[i, j]:
                work[i] = work[i] - work[i, j] * work[j]
    return work[:, n:]


@dataclass(frozen=True, slots=True)
class _Measured:
    """Row ``row`` of H measures ``state`` alone, whose rate is ``rate``."""

    row: int
    state: int
    rate: int | None


def _measured(dynamics: Dynamics) -> list[_Measured]:
    """The measured states with their rates; together they must be all states."""
    rows: dict[int, int] = {}
    for j, row in enumerate(dynamics.H):
        states = np.flatnonzero(row)
        if len(states) != 1:
            raise _unsuited(f"measurement {j} depends on {len(states)} states, not on one alone")
        if int(states[0]) in rows:
            raise _unsuited(f"{dynamics.state_names[states[0]]} is measured twice")
        rows[int(states[0])] = j
    pairs = [_Measured(j, i, _rate(dynamics, i, rows)) for i, j in rows.items()]
    started = [*rows, *(pair.rate for pair in pairs if pair.rate is not None)]
    for i, name in enumerate(dynamics.state_names):
        if started.count(i) != 1:
            reason = "neither measured nor a rate" if i not in started else "the rate of two states"
            raise _unsuited(f"{name} is {reason} of measured states")
    return pairs


def _rate(dynamics: Dynamics, i: int, measured: dict[int, int]) -> int | None:
    """The one state, itself unmeasured, that moves state i; None if i only keeps its value."""
    F, names = dynamics.F, dynamics.state_names
    movers = [int(k) for k in np.flatnonzero(F[i]) if k != i and k not in measured]
    if not movers:
        return None
    k = movers[0]
    if len(movers) > 1 or any(j in measured for j in np.flatnonzero(F[i]) if j != i):
        raise _unsuited(f"{names[i]} is moved by more than one state")
    if any(j != k for j in np.flatnonzero(F[k])) or F[k, k] == 0:
        raise _unsuited(f"the rate {names[k]} does not keep its value from step to step")
    if dynamics.B[[i, k]].any():
        raise _unsuited(f"controls move {names[i]} or {names[k]}")
    return k


def _unsuited(reason: str, kind: str = "two_point") -> Exception:
    remedy = 'use kind = "given" with x and P'
    return checks.fault("initial.kind", f' = "{kind}": {reason}: {remedy}')
