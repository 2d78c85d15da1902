"""OpenCV's Kalman filter, the software baseline of liu2007, timed in the run that prints its figures."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from kalmanhdl.model.state_space import LinearModel

Array = NDArray[np.float64]

REPEATS = 5
PRECISIONS: dict[str, DTypeLike] = {"float32": np.float32, "float64": np.float64}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoftwareRun:
    """A filter in software: the state after the last step (n,), and the seconds of a step."""

    version: str
    precision: str
    x: Array
    seconds_per_step: float


def available() -> bool:
    """Whether OpenCV is installed."""
    return find_spec("cv2") is not None


def timed(model: LinearModel, z: Array) -> tuple[SoftwareRun, ...]:
    """One track in single and in double precision, z (steps, m): each the fastest of ``REPEATS`` runs.

    On one thread; a step is a call of ``predict`` and one of ``correct``, from Python. The first row of z
    starts the track, and is not timed.
    """
    return tuple(_run(model, z, precision) for precision in PRECISIONS)


def _run(model: LinearModel, z: Array, precision: str) -> SoftwareRun:
    import cv2

    plots = np.ascontiguousarray(z[..., None], dtype=PRECISIONS[precision])
    best = np.inf
    with _one_thread(cv2):
        for _ in range(REPEATS):
            filter_ = _filter(cv2, model, PRECISIONS[precision])
            filter_.correct(plots[0])
            begin = time.perf_counter()
            for plot in plots[1:]:
                filter_.predict()
                filter_.correct(plot)
            best = min(best, time.perf_counter() - begin)
    return SoftwareRun(
        version=cv2.__version__,
        precision=precision,
        x=np.asarray(filter_.statePost, dtype=np.float64).ravel(),
        seconds_per_step=best / (len(plots) - 1),
    )


def _filter(cv2: Any, model: LinearModel, precision: DTypeLike) -> Any:
    kind = cv2.CV_32F if precision is np.float32 else cv2.CV_64F
    filter_ = cv2.KalmanFilter(model.n, model.m, 0, kind)
    start = model.initial
    for name, matrix in (
        ("transitionMatrix", model.F),
        ("measurementMatrix", model.H),
        ("processNoiseCov", model.Q),
        ("measurementNoiseCov", model.R),
        ("statePre", start.x[:, None]),
        ("errorCovPre", start.P),
    ):
        setattr(filter_, name, np.ascontiguousarray(matrix, dtype=precision))
    return filter_


@contextmanager
def _one_thread(cv2: Any) -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
