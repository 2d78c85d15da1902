"""Pictures for a terminal's user and a README: the track, and the schedule, by matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from kalmanhdl.model.model import Model
from kalmanhdl.report.accuracy import featured
from kalmanhdl.report.geometry import Kind, Plane, ellipse, plane, points, seen_pair
from kalmanhdl.report.lanes import Bar, lanes
from kalmanhdl.report.palette import AMBER, BLUE, GREEN, SERIES
from kalmanhdl.schedule.summary import Summary
from kalmanhdl.simulate.side_by_side import SideBySide

_ELLIPSES = 30
_POINTS = 20_000
INK = "#4a525b"


def save_track(model: Model, name: str, simulation: SideBySide, path: Path) -> None:
    """The featured track with ellipses of 95 %; the suffix of the path chooses PNG or SVG."""
    shown = plane(model)
    figure, axes = new_axes(8.0, 5.0)
    track = featured(simulation)
    if shown.kind is Kind.TIME:
        _draw_over_time(axes, model, simulation, shown, track)
    else:
        _draw_on_plane(axes, model, simulation, shown, track)
    axes.set_xlabel(shown.labels[0])
    axes.set_ylabel(shown.labels[1])
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    axes.set_title(f"{name}, track {simulation.plots.tracks[track]}", **TITLE)
    save(figure, path)


def save_schedule(summary: Summary, name: str, path: Path) -> None:
    """The operations of one step over clock cycles; the suffix of the path chooses PNG or SVG."""
    title = f"{name}: one step in {summary.latency_cycles} clock cycles"
    save_bars(lanes(summary.rows), title, path)


def save_bars(bars: Sequence[Bar], title: str, path: Path) -> None:
    """Work over clock cycles; the suffix of the path chooses PNG or SVG."""
    groups = list(dict.fromkeys(bar.work.group for bar in bars))
    count = 1 + max((bar.lane for bar in bars), default=0)
    figure, axes = new_axes(9.0, min(9.0, 1.6 + 0.075 * count))
    for k, group in enumerate(groups):
        boxes = [
            [(b.left + 0.04, b.lane + 0.08), (b.right - 0.04, b.lane + 0.08),
             (b.right - 0.04, b.lane + 0.92), (b.left + 0.04, b.lane + 0.92)]
            for b in bars if b.work.group == group
        ]  # fmt: skip
        axes.add_collection(PolyCollection(boxes, facecolors=SERIES[k % len(SERIES)]))
    axes.set_xlim(-0.2, max((bar.right for bar in bars), default=0) + 0.2)
    axes.set_ylim(count + 0.5, -0.5)
    axes.set_yticks([])
    axes.set_xlabel("clock cycle")
    axes.xaxis.get_major_locator().set_params(integer=True)
    patches = [Patch(color=SERIES[k % len(SERIES)], label=group) for k, group in enumerate(groups)]
    axes.legend(handles=patches, frameon=False, fontsize=8, labelcolor=INK, ncols=4,
                loc="lower left", bbox_to_anchor=(0, 1.0))  # fmt: skip
    figure.suptitle(title, fontsize=11, color=INK, x=0.01, ha="left")
    save(figure, path)


TITLE: dict[str, Any] = {"fontsize": 11, "color": INK, "loc": "left"}


def _draw_on_plane(axes: Any, model: Model, simulation: SideBySide, shown: Plane, track: int) -> None:
    plots, states = simulation.plots, list(shown.states)
    if shown.measurements:
        seen = points(shown, seen_pair(model, shown, plots.z[:, track]))[:_POINTS]
        axes.plot(*seen.T, ".", color=AMBER, markersize=4, label="plots")
    if plots.truth is not None:
        axes.plot(*points(shown, plots.truth[:, track][:, states]).T, color=GREEN, label="truth")
    exact = simulation.exact
    axes.plot(*points(shown, exact.x[:, track][:, states]).T, color=BLUE, label="estimate, bit-exact")
    rows = np.flatnonzero(simulation.valid[:, track])
    for k in rows[:: 1 + len(rows) // _ELLIPSES]:
        around = ellipse(shown, exact.x[k, track], exact.P[k, track])
        axes.plot(
            *around.T, color=BLUE, linewidth=0.7, alpha=0.6, label="95 % ellipse" if k == rows[0] else None
        )
    axes.set_aspect("equal", adjustable="datalim")


def _draw_over_time(axes: Any, model: Model, simulation: SideBySide, shown: Plane, track: int) -> None:
    plots, i = simulation.plots, shown.states[0]
    x, P = simulation.exact.x[:_POINTS, track, i], simulation.exact.P[:_POINTS, track, i, i]
    step, half = np.arange(len(x)), 1.96 * np.sqrt(np.maximum(P, 0))
    axes.fill_between(step, x - half, x + half, color=BLUE, alpha=0.15, linewidth=0, label="95 % band")
    if shown.measurements:
        seen = seen_pair(model, shown, plots.z[:_POINTS, track])[:, 0]
        axes.plot(step, seen, ".", color=AMBER, markersize=4, label="plots")
    if plots.truth is not None:
        axes.plot(step, plots.truth[:_POINTS, track, i], color=GREEN, label="truth")
    axes.plot(step, x, color=BLUE, label="estimate, bit-exact")


def new_axes(width: float, height: float) -> tuple[Figure, Any]:
    """An empty figure in the look of all pictures; sizes in inches."""
    figure, (axes,) = new_panels(width, height, 1)
    return figure, axes


def new_panels(width: float, height: float, count: int) -> tuple[Figure, list[Any]]:
    """As ``new_axes``, with several panels below each other over one horizontal axis."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    panels = list(figure.subplots(count, sharex=True, squeeze=False)[:, 0])
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e3e6ea", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(colors=INK, labelsize=9)
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set(color=INK, fontsize=10)
    return figure, panels


def save(figure: Figure, path: Path) -> None:
    """Write a figure; the suffix of the path chooses PNG or SVG."""
    # No date and no random names, so that equal builds give equal files.
    with mpl.rc_context({"svg.hashsalt": "kalmanhdl"}):
        figure.savefig(path, dpi=130, metadata={"Date": None} if path.suffix == ".svg" else None)
