"""The experiment of wu2012: a target comes in to a short range defence radar, and its position is denoised.

Wu, Wang & Ji, Design and Realization of Short Range Defence Radar Target Tracking System Based on DSP/FPGA,
2012. Section 5 gives the target, the noises and the filter; fig. 22 to 25 show it. How long it is
followed is not said: here for 1500 frames, until it is at 208 m.

The formulas as printed hold but for these: in eq. 3 alpha_x stands in the last three rows (all three are
equal); eq. 7, see ``model.conversion``; in eq. 14 the last row takes Xf7 for Xf8; step 8 of section 3.3
repeats 2 to 6 without 7, the covariance. How X0 and P0 follow from three frames is not said.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.algorithm import Converted
from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.model.conversion import conversion
from kalmanhdl.model.converted import ConvertedModel, converted_model
from kalmanhdl.model.initial import three_point
from kalmanhdl.model.singer import singer
from kalmanhdl.simulate.commands import commands, started
from kalmanhdl.simulate.reference import reference

Array = NDArray[np.float64]

PERIOD_S = 0.8192e-3
ALPHA_HZ = 0.001
GAMMA = 0.0129
RANGE_M, SPEED_M_PER_S = 700.0, 400.0
ELEVATION = math.pi / 90
AZIMUTH_FIRST, AZIMUTH_LAST = math.pi / 90, math.pi / 1000
SIGMAS = (1 / 6, math.pi / 180, math.pi / 270)
"""Of range (m), azimuth and elevation (rad): the roots of 1/36, pi^2/32400 and pi^2/72900."""

FRAMES = 1500
SETTLED = 500
"""Frames after which the filter is compared with the plots."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Denoising:
    """Plots and estimates of the position along x, y and z, in m, over ``frames`` after it has settled.

    ``truth`` (steps, 3), ``plots`` and ``estimates`` (steps, tracks, 3), NaN before the start. ``plot_error``
    and ``error`` (3,) are root mean squares, ``bias`` (3,) the mean error of the estimates, ``expected`` (3,)
    the deviation that the filter claims.
    """

    truth: Array
    plots: Array
    estimates: Array
    plot_error: Array
    error: Array
    bias: Array
    expected: Array


def paper_model() -> ConvertedModel:
    """The paper's model: Singer acceleration with Gamma Q Gamma', spherical plots, three frames to start."""
    motion = singer(
        T=PERIOD_S,
        tau=1 / ALPHA_HZ,
        noise=GAMMA,
        axes=3,
        discretisation="piecewise",
        order="derivative",
    )
    return converted_model(
        motion.F,
        motion.H,
        motion.Q,
        np.diag(np.square(SIGMAS)),
        initial=three_point(),
        state_names=motion.state_names,
        state_units=("m",) * 3 + ("m/s",) * 3 + ("m/s^2",) * 3,
        measurement_range=np.array([[1, 800], [-math.pi, math.pi], [-math.pi / 2, math.pi / 2]]),
    )


def paper_target(frames: int = FRAMES) -> Array:
    """Range, azimuth and elevation of the target, frame by frame. Shape (frames, 3).

    It flies in at its speed, its elevation constant, its azimuth falling evenly between the two limits.
    """
    distance = RANGE_M - SPEED_M_PER_S * PERIOD_S * np.arange(frames)
    azimuth = np.linspace(AZIMUTH_FIRST, AZIMUTH_LAST, frames)
    return np.stack([distance, azimuth, np.full(frames, ELEVATION)], axis=1)


def denoise(
    model: ConvertedModel,
    target: ArrayLike,
    algorithm: Converted | None = None,
    *,
    tracks: int = 1,
    seed: int = 1,
    settled: int = SETTLED,
) -> Denoising:
    """The float reference on noisy plots of a target, each of the tracks with noise of its own.

    ``target`` (steps, m) holds what would be measured without noise; the noise is that of the model.
    """
    algorithm = algorithm or Converted()
    exact = np.asarray(target, dtype=np.float64)
    steps, m = exact.shape
    random = np.random.default_rng(seed)
    noise = random.standard_normal((steps, tracks, m)) * np.sqrt(np.array(model.variances))
    z, active = exact[:, None] + noise, np.ones((steps, tracks), bool)
    given = commands(model, z, active)
    found = reference(algorithm(model), given, z, np.zeros((steps, tracks, model.p)))
    H = model.positions.H
    # Without noise there is no bias to take off.
    truth = rows(conversion((0.0,) * m).mean(elements(exact)), (steps,))
    plots = rows(conversion(model.variances).mean(elements(z)), (steps, tracks))
    begun = started(model, given)[..., None]
    estimates = np.where(begun, found.x @ H.T, np.nan)
    variances = np.einsum("ij,stjk,ik->sti", H, found.P, H)
    error, raw = (estimates - truth[:, None])[settled:], (plots - truth[:, None])[settled:]
    return Denoising(
        truth=truth,
        plots=plots,
        estimates=estimates,
        plot_error=np.sqrt((raw**2).mean(axis=(0, 1))),
        error=np.sqrt((error**2).mean(axis=(0, 1))),
        bias=error.mean(axis=(0, 1)),
        expected=np.sqrt(variances[settled:].mean(axis=(0, 1))),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Figures:
    """The paper's filter, and the same with R at the better of prediction and measurement."""

    paper: Denoising
    better: Denoising


def figures(*, tracks: int = 1, seed: int = 1, frames: int = FRAMES) -> Figures:
    """Fig. 22 to 25: the target, its plots and its estimates."""
    model, target = paper_model(), paper_target(frames)
    return Figures(
        paper=denoise(model, target, Converted(), tracks=tracks, seed=seed),
        better=denoise(model, target, Converted(at="better"), tracks=tracks, seed=seed),
    )
