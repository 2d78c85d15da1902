"""The experiment of wu2012: a target comes in to a short range defence radar, and its position is denoised.

Wu, Wang & Ji, Design and Realization of Short Range Defence Radar Target Tracking System Based on DSP/FPGA,
2012. Section 5 gives the target, the noises and the filter; fig. 22 to 25 show it. How long it is
followed is not said: here for 1500 frames, until it is at 208 m. Then the same filter follows a
measured path.

The formulas as printed hold but for these: in eq. 3 alpha_x stands in the last three rows (all three are
equal); eq. 7, see ``model.conversion``; in eq. 14 the last row takes Xf7 for Xf8; step 8 of section 3.3
repeats 2 to 6 without 7, the covariance. How X0 and P0 follow from three frames is not said.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalmanhdl.algorithm import Converted
from kalmanhdl.design import Design
from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.model.conversion import conversion
from kalmanhdl.model.converted import ConvertedModel, converted_model
from kalmanhdl.model.initial import three_point
from kalmanhdl.model.singer import singer
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.report.chart import Chart, Line, Panel, Style
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.reproduce.uav import UAV_NOISE, UAV_SETTLED, UAV_TAU_S, uav_model, uav_track
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
        measurement_range=np.array([[50, 800], [-math.pi, math.pi], [-math.pi / 18, math.pi / 3]]),
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
    exact = np.asarray(target, dtype=np.float64)
    # Without noise there is no bias to take off.
    truth = rows(conversion((0.0,) * exact.shape[1]).mean(elements(exact)), (len(exact),))
    z = noisy(model, exact, tracks, seed)
    return denoise_plots(model, z, truth, algorithm or Converted(), settled=settled)


def denoise_plots(
    model: ConvertedModel, z: Array, truth: Array, algorithm: Converted, *, settled: int
) -> Denoising:
    """The float reference on plots z (steps, tracks, m) of a path ``truth`` (steps, 3), in m."""
    steps, tracks, _ = z.shape
    given = commands(model, z, np.ones((steps, tracks), bool))
    found = reference(algorithm(model), given, z, np.zeros((steps, tracks, model.p)))
    H = model.positions.H
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
class Single:
    """The paper's filter in IEEE 754 single precision, beside double precision on the same plots.

    ``error`` (3,) is the root mean square error of the positions in single precision, ``apart`` (3,) how far
    they are from those in double precision at most, both in m; ``unbounded`` counts values that became
    infinite or undefined.
    """

    error: Array
    apart: Array
    unbounded: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Figures:
    """The paper's filter, the same with R at the better of two places, and in single precision; and the
    paper's filter on the measured path of a UAV, ``uav``, in double and in single precision."""

    paper: Denoising
    better: Denoising
    single: Single
    uav: Denoising
    uav_single: Single


def noisy(model: ConvertedModel, target: Array, tracks: int, seed: int) -> Array:
    """What the radar measures of a target (steps, m), with noise of its own for each track."""
    random = np.random.default_rng(seed)
    noise = random.standard_normal((len(target), tracks, target.shape[1]))
    return np.asarray(target[:, None] + noise * np.sqrt(np.array(model.variances)))


def in_single(model: ConvertedModel, z: Array, truth: Array, settled: int = SETTLED) -> Single:
    """The paper's arithmetic on plots z (steps, tracks, m) of a path ``truth`` (steps, 3)."""
    numerics = FloatSpecification(exponent=8, mantissa=23)
    found = Design(name="wu2012", model=model, algorithm=Converted(), numerics=numerics).simulate(z)
    H = model.positions.H
    exact, double = ((x @ H.T)[settled:] for x in (found.exact.x, found.reference.x))
    error = exact - truth[settled:, None]
    return Single(
        error=np.sqrt((error**2).mean(axis=(0, 1))),
        apart=np.abs(exact - double).max(axis=(0, 1)),
        unbounded=found.saturations,
    )


def figures(
    progress: Progress = silent,
    *,
    tracks: int = 1,
    seed: int = 1,
    frames: int = FRAMES,
    settled: int = SETTLED,
) -> Figures:
    """Fig. 22 to 25: the target, its plots and its estimates."""
    model, target = paper_model(), paper_target(frames)
    progress("the paper's filter in double precision")
    paper = denoise(model, target, Converted(), tracks=tracks, seed=seed, settled=settled)
    progress("R at the better of prediction and measurement")
    better = denoise(model, target, Converted(at="better"), tracks=tracks, seed=seed, settled=settled)
    progress("the paper's filter in single precision")
    single = in_single(model, noisy(model, target, tracks, seed), paper.truth, settled)
    progress("the same on the track of a UAV")
    uav, path = uav_model(), uav_track()
    return Figures(
        paper=paper,
        better=better,
        single=single,
        uav=denoise_plots(uav, path.z, path.truth, Converted(), settled=UAV_SETTLED),
        uav_single=in_single(uav, path.z, path.truth, UAV_SETTLED),
    )


def reproduction(found: Figures) -> Reproduction:
    """Errors of position before and after, axis by axis."""
    data = facts("wu2012")
    figures_by_row = (
        ("plots", found.paper.plot_error),
        ("the paper's filter, double precision", found.paper.error),
        ("the same, mean error", found.paper.bias),
        ("the same, deviation it claims", found.paper.expected),
        ("the paper's filter, single precision", found.single.error),
        ("single off double at most", found.single.apart),
        ("R at the better place, double precision", found.better.error),
        ("the same, mean error", found.better.bias),
        ("the same, deviation it claims", found.better.expected),
        ("UAV: plots", found.uav.plot_error),
        ("UAV: double precision", found.uav.error),
        ("UAV: deviation it claims", found.uav.expected),
        ("UAV: single precision", found.uav_single.error),
        ("UAV: single off double at most", found.uav_single.apart),
    )
    sigma = np.sqrt(uav_model().variances)
    return Reproduction(
        title=f"Wu, Wang & Ji 2012: root mean square errors of position in m, after {SETTLED} frames",
        columns=("", "x", "y", "z"),
        rows=tuple((what, *(f"{value:.4g}" for value in values)) for what, values in figures_by_row),
        notes=(
            f"Of fig. {data['figures']} the paper says that {data['states']}; "
            "it prints no errors to compare.",
            f"How long the target is followed is not said: here {len(found.paper.truth)} frames of "
            f"{1e3 * PERIOD_S:g} ms. How X0 and P0 follow from three frames neither: here as three_point.",
            "The paper takes R at the measurement, whose noise it then shares: the mean error along x, the "
            "line of sight, is far beyond the deviation that the filter claims.",
            f"Single precision is bit-exact, every operation rounded once; "
            f"{found.single.unbounded + found.uav_single.unbounded} values became infinite or undefined.",
            f"UAV: {len(found.uav.truth)} GPS positions of a rotary UAV, one a second, as a ground radar "
            f"sees them with noise drawn of {sigma[0]:.3g} m in range, {np.degrees(sigma[1]):.3g} and "
            f"{np.degrees(sigma[2]):.3g} degrees in azimuth and elevation; x is east, y north, z up, after "
            f"{UAV_SETTLED} s. Manoeuvres of {UAV_NOISE[0]:g}, {UAV_NOISE[1]:g} and {UAV_NOISE[2]:g} m/s^2 "
            f"kept for {UAV_TAU_S:g} s.",
            f"{data['said']}. designs/wu2012_single.toml is its filter in hardware.",
        ),
        charts={
            "position": _position_chart(found),
            "error": _error_chart(found),
            "uav": _uav_chart(found.uav),
        },
    )


def _position_chart(found: Figures) -> Chart:
    seconds: Array = np.arange(len(found.paper.truth), dtype=np.float64) * PERIOD_S
    panels = []
    for axis, name in enumerate("xyz"):
        lines = (
            Line(label="plots", x=seconds, y=found.paper.plots[:, 0, axis], color=4, style=Style.DOTS),
            Line(label="the paper's filter", x=seconds, y=found.paper.estimates[:, 0, axis], color=0),
            Line(label="truth", x=seconds, y=found.paper.truth[:, axis], color=2, style=Style.DASHED),
        )
        panels.append(Panel(label=f"{name} (m)", lines=lines))
    return Chart(
        title="wu2012, fig. 22 to 25: position before and after", label="time (s)", panels=tuple(panels)
    )


def _uav_chart(found: Denoising) -> Chart:
    seconds: Array = np.arange(len(found.truth), dtype=np.float64)
    panels = []
    for axis, name in enumerate(("east", "north", "up")):
        lines = (
            Line(label="plots", x=seconds, y=found.plots[:, 0, axis], color=4, style=Style.DOTS),
            Line(label="the paper's filter", x=seconds, y=found.estimates[:, 0, axis], color=0),
            Line(label="GPS", x=seconds, y=found.truth[:, axis], color=2, style=Style.DASHED),
        )
        panels.append(Panel(label=f"{name} (m)", lines=lines))
    return Chart(title="wu2012 on the track of a UAV", label="time (s)", panels=tuple(panels))


def _error_chart(found: Figures) -> Chart:
    seconds: Array = np.arange(len(found.paper.truth), dtype=np.float64) * PERIOD_S
    after = SETTLED // 5
    panels = []
    for axis, name in enumerate("xyz"):
        ways = (
            ("plots", found.paper.plots, 4, Style.DOTS),
            ("the paper's filter", found.paper.estimates, 0, Style.SOLID),
            ("R at the better place", found.better.estimates, 1, Style.SOLID),
        )
        lines = tuple(
            Line(
                label=label,
                x=seconds[after:],
                y=(x[:, 0, axis] - found.paper.truth[:, axis])[after:],
                color=color,
                style=style,
            )
            for label, x, color, style in ways
        )
        panels.append(Panel(label=f"error of {name} (m)", lines=lines))
    return Chart(title="wu2012: error of position before and after", label="time (s)", panels=tuple(panels))
