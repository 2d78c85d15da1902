"""What formats must hold: root mean square errors near the float reference's, NEES and NIS in their bands.

Source of the bands: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation,
section 5.4.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Filter
from kalmanhdl.explore.format_engine import Drive, FormatEngine, Run
from kalmanhdl.explore.program import Program
from kalmanhdl.explore.tracks import Judged, drive_of
from kalmanhdl.numerics.integers import Reals
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.simulate.commands import Command
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.metrics import nees
from kalmanhdl.simulate.side_by_side import covariance_of

Array = NDArray[np.float64]

# By so much of half a band may NEES and NIS move away from the float reference's; the rest is chance's.
SHIFT = 0.25
# Tracks on which the bands hold in the end, and by whose bands the search measures.
BAND_TRACKS = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What a run is worth: ``share`` is how much of what is allowed it uses, ``error`` the relative excess of
    a state's error, ``shift`` that of NEES or NIS in half bands; NaN is what was not asked for."""

    share: float
    error: float
    shift: float

    def worse(self, other: "Verdict") -> "Verdict":
        """The worse of two, figure by figure."""
        return Verdict(
            share=max(self.share, other.share),
            error=float(np.fmax(self.error, other.error)),
            shift=float(np.fmax(self.shift, other.shift)),
        )


NOTHING = Verdict(share=0.0, error=np.nan, shift=np.nan)


class Case(Protocol):
    """Tracks, and what formats must hold on them."""

    @property
    def engine(self) -> FormatEngine:
        """The program with the outputs that are looked at."""

    @property
    def drive(self) -> Drive:
        """The tracks as the program is fed them."""

    def verdict(self, run: Run) -> Verdict:
        """What a run of the tracks is worth."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorCase:
    """No state's error exceeds the float reference's by more than ``tolerance`` of it.

    An infinite tolerance asks only that there are estimates.
    """

    engine: FormatEngine
    drive: Drive
    on: Judged
    scales: Array
    tolerance: float

    def verdict(self, run: Run) -> Verdict:
        """By the greatest excess of a state."""
        error = float(np.nanmax(self.on.excess(self._estimates(run))))
        if not np.isfinite(error):
            return Verdict(share=np.inf, error=np.inf, shift=np.nan)
        return Verdict(share=error / self.tolerance, error=error, shift=np.nan)

    def worst(self, run: Run, count: int) -> Plots:
        """The tracks on which a run comes furthest from the float reference."""
        return self.on.worst(self._estimates(run), count)

    def _estimates(self, run: Run) -> Array:
        return np.asarray(np.moveaxis(run.outputs, 0, -1) * self.scales)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandCase:
    """NEES and NIS stay where the float reference has them, on tracks none of whose plots is missed.

    NEES is averaged over the tracks at the end of each octave of their age, NIS over all updates.
    """

    engine: FormatEngine
    drive: Drive
    on: Judged
    filter_: Filter
    scales: Mapping[str, float]

    @staticmethod
    def of(
        program: Program, specification: FixedSpecification, filter_: Filter, on: Judged, reals: Reals
    ) -> "BandCase":
        """The case of tracks, with all outputs that it takes."""
        n = on.reference.shape[-1]
        kept = {each.element(place) for each in filter_.kept for place in each.places()}
        names = [name for name, _, _ in program.states if name in kept]
        names += [f"x[{i}]" for i in range(n)] + [f"P[{i},{i}]" for i in range(n)] + ["nis"]
        return BandCase(
            engine=FormatEngine.of(program, specification, tuple(dict.fromkeys(names))),
            drive=drive_of(program, reals.scaling, on),
            on=on,
            filter_=filter_,
            scales=reals.scales,
        )

    def verdict(self, run: Run) -> Verdict:
        """By the greatest move, in half bands of 95 % for as many tracks as judge in the end."""
        pairs = zip(self.engine.outputs, run.outputs, strict=True)
        values = {name: output * self.scales[name] for name, output in pairs}
        n = self.on.reference.shape[-1]
        kept = {each.element(place) for each in self.filter_.kept for place in each.places()}
        x = np.stack([values[f"x[{i}]"] for i in range(n)], axis=-1)
        P = covariance_of(self.filter_, {name: values[name] for name in kept & values.keys()})
        for i in range(n):
            P[..., i, i] = values[f"P[{i},{i}]"]
        moved = np.abs(_statistics(self.on, x, P, values["nis"]) - self._reference())
        shift = float(np.max(moved)) if np.isfinite(moved).all() else np.inf
        return Verdict(share=shift / SHIFT, error=np.nan, shift=shift)

    def _reference(self) -> Array:
        estimates = self.on.estimates
        return _statistics(self.on, estimates.x, estimates.P, estimates.nis)


def _statistics(on: Judged, x: Array, P: Array, nis: Array) -> Array:
    """NEES at the end of each octave, and NIS, in half bands."""
    assert on.plots.truth is not None
    n, m = x.shape[-1], on.plots.z.shape[-1]
    found = []
    for k in _octave_ends(on.valid):
        there = on.valid[k]
        squares = _regular_nees(x[k, there] - on.plots.truth[k, there], P[k, there])
        found.append(squares.mean() / (1.96 * np.sqrt(2 * n / BAND_TRACKS)))
    updates = on.valid & (on.commands == Command.UPDATE)
    many = updates.sum() * BAND_TRACKS / x.shape[1]
    return np.array([*found, nis[updates].mean() / (1.96 * np.sqrt(2 * m / many))])


def _octave_ends(valid: NDArray[np.bool_]) -> list[int]:
    rows = np.flatnonzero(valid.any(axis=1))
    ends = [2**k - 1 for k in range(len(rows).bit_length()) if 2**k <= len(rows)]
    return [int(rows[k]) for k in dict.fromkeys([*ends, len(rows) - 1])]


def _regular_nees(error: Array, P: Array) -> Array:
    """NEES, infinite where rounding has left a covariance without inverse."""
    spread = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), np.finfo(float).tiny))
    scaled = P / (spread[:, :, None] * spread[:, None, :])
    regular = np.linalg.eigvalsh(scaled)[:, 0] > 1e-14
    result = np.full(len(error), np.inf)
    result[regular] = nees((error / spread)[regular], scaled[regular])
    return result
