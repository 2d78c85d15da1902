"""The figures of the page, as Bokeh draws them."""

from collections.abc import Iterator, Sequence

import numpy as np
from bokeh.models import ColumnDataSource, CustomJSTickFormatter, HoverTool, Range1d
from bokeh.plotting import figure as bokeh_figure
from numpy.typing import NDArray

from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.report.accuracy import featured, measured_states, updated
from kalmanhdl.report.convergence import gains, innovation_covariances, priors
from kalmanhdl.report.geometry import Kind, Plane, ellipse, label, plane, points, seen_pair, with_unit
from kalmanhdl.report.lanes import Bar
from kalmanhdl.report.palette import AMBER, BLUE, GREEN, GREY, ORANGE, SERIES
from kalmanhdl.report.plots import states_shown
from kalmanhdl.simulate.side_by_side import SideBySide

Array = NDArray[np.float64]

# What one figure holds at most: points, tracks, ellipses.
_POINTS = 2400
TRACKS = 8
_ELLIPSES = 36
_INK = "#767e89"
_GRID = "rgba(128, 134, 142, 0.22)"
# The float reference and, on top of it, the bit-exact filter.
_BROAD = {"line_width": 4, "line_alpha": 0.3}
_NARROW = {"line_width": 1.3}
_TICK = "return String(Number(tick.toPrecision(6))).replace(/-/g, '\u2212')"
_TOOLS = "pan,box_zoom,wheel_zoom,reset,save"


def track_figure(model: Model, simulation: SideBySide) -> object:
    """The featured track on its plane, with ellipses that hold 95 %."""
    shown = plane(model)
    if shown.kind is Kind.TIME:
        return state_figure(model, simulation, shown.states[0], height=360)
    return _plane_figure(model, simulation, shown, [featured(simulation)])


def tracks_figure(model: Model, simulation: SideBySide) -> object | None:
    """Several tracks on their plane; None where there is one track, or no plane."""
    shown, count = plane(model), len(simulation.plots.tracks)
    if shown.kind is Kind.TIME or count == 1:
        return None
    return _plane_figure(model, simulation, shown, list(range(min(TRACKS, count))))


def _plane_figure(model: Model, simulation: SideBySide, shown: Plane, tracks: list[int]) -> object:
    drawn = _figure(*shown.labels, height=460, match_aspect=True)
    _draw_lines(drawn, model, simulation, shown, tracks)
    every = max(1, int(simulation.valid[:, tracks].sum()) // _ELLIPSES)
    lines = [
        ellipse(shown, simulation.exact.x[k, t], simulation.exact.P[k, t])
        for t in tracks
        for k in np.flatnonzero(simulation.valid[:, t])[::every]
    ]
    drawn.multi_line(
        [e[:, 0] for e in lines],
        [e[:, 1] for e in lines],
        color=BLUE,
        line_width=1,
        line_alpha=0.55,
        legend_label="95 % ellipse",
    )
    if shown.measurements:
        seen = points(shown, seen_pair(model, shown, simulation.plots.z[:, tracks])).reshape(-1, 2)
        drawn.scatter(
            *_thinned(seen).T, size=4, color=AMBER, alpha=0.8, line_color=None, legend_label="plots"
        )
    return _finished(drawn)


def _draw_lines(
    drawn: bokeh_figure, model: Model, simulation: SideBySide, shown: Plane, tracks: list[int]
) -> None:
    states = list(shown.states)
    truth = simulation.plots.truth
    lines = [(simulation.exact.x, BLUE, "estimate, bit-exact", 1.8, "solid")]
    if truth is not None:
        lines.insert(0, (truth, GREEN, "truth", 2.2, "solid"))
    for values, color, legend, width, dash in lines:
        paths = [_thinned(points(shown, values[simulation.plots.active[:, t], t][:, states])) for t in tracks]
        drawn.multi_line(
            [p[:, 0] for p in paths],
            [p[:, 1] for p in paths],
            color=color,
            line_width=width,
            line_dash=dash,
            legend_label=legend,
        )


def state_figure(model: Model, simulation: SideBySide, state: int, height: int = 250) -> object:
    """One state of the featured track: plots where it is measured, truth, and the estimate in its band."""
    rows, track, x, title = _axis(simulation)
    drawn = _figure(title, label(model, state), height=height)
    value = simulation.exact.x[rows, track, state]
    half = 1.96 * np.sqrt(np.maximum(simulation.exact.P[rows, track, state, state], 0))
    drawn.varea(x, value - half, value + half, color=BLUE, fill_alpha=0.15, legend_label="estimate ± 1.96 σ")
    for j, p in measured_states(model).items():
        if p == state:
            plot = states_shown(model, simulation.plots.z[rows, track], j)
            drawn.scatter(x, plot, size=4, color=AMBER, alpha=0.85, line_color=None, legend_label="plots")
    if simulation.plots.truth is not None:
        drawn.line(
            x, simulation.plots.truth[rows, track, state], color=GREEN, line_width=2, legend_label="truth"
        )
    drawn.line(x, value, color=BLUE, line_width=1.6, legend_label="estimate ± 1.96 σ")
    return _finished(drawn)


def innovation_figure(model: Model, simulation: SideBySide, j: int) -> object:
    """One innovation of the featured track; of a linear model in its band of 95 %."""
    rows, track, x, title = _axis(simulation)
    used = updated(simulation, model.initial.before_update)[rows, track, j]
    value = np.where(used, simulation.exact.innovation[rows, track, j], np.nan)
    drawn = _figure(title, _measured(model, j), height=230)
    if isinstance(model, LinearModel):
        S = innovation_covariances(model, priors(model, simulation, simulation.reference.P))
        half = 1.96 * np.sqrt(S[rows, track, j, j])
        drawn.varea(x, -half, half, color=GREY, fill_alpha=0.2, legend_label="± 1.96 √S")
    drawn.line(x, value, color=BLUE, line_width=1, line_alpha=0.6)
    drawn.scatter(x, value, size=4.5, color=BLUE, line_color=None, legend_label="innovation")
    return _finished(drawn)


def inside_band(model: LinearModel, simulation: SideBySide, j: int) -> tuple[int, int]:
    """How many innovations of all tracks lie in their 95 % band, and of how many."""
    S = innovation_covariances(model, priors(model, simulation, simulation.reference.P))[..., j, j]
    value = simulation.exact.innovation[..., j]
    counted = updated(simulation, model.initial.before_update)[..., j] & np.isfinite(S)
    inside = counted & (np.abs(value) <= 1.96 * np.sqrt(np.where(counted, S, 1.0)))
    return int(inside.sum()), int(counted.sum())


def deviation_figure(model: Model, simulation: SideBySide) -> object:
    """The standard deviations of the featured track: reference and bit-exact."""
    rows, track, x, title = _axis(simulation)
    drawn = _figure(title, "standard deviation", height=300, y_axis_type="log")
    both = ((simulation.reference.P, _BROAD), (simulation.exact.P, _NARROW))
    for i, color in zip(range(model.n), _colors(model.n), strict=True):
        for P, style in both:
            variance = P[rows, track, i, i]
            deviation = np.sqrt(np.where(variance > 0, variance, np.nan))
            drawn.line(x, deviation, color=color, legend_label=label(model, i), **style)
    return _finished(drawn, columns=2)


def gain_figure(model: LinearModel, simulation: SideBySide) -> object:
    """The gains of the featured track that their covariances mean: reference and bit-exact."""
    rows, track, x, title = _axis(simulation)
    used = updated(simulation, model.initial.before_update)[rows, track]
    both = [
        gains(model, priors(model, simulation, P)[rows, track], used)
        for P in (simulation.reference.P, simulation.exact.P)
    ]
    drawn = _figure(title, "|gain|", height=300, y_axis_type="log")
    last = np.nanmax(np.abs(both[0]), axis=0) if np.isfinite(both[0]).any() else np.zeros((model.n, model.m))
    shown = np.argwhere(last > 0)[: 2 * len(SERIES)]
    for (i, j), color in zip(shown, _colors(len(shown)), strict=True):
        name = f"{model.state_names[i]} ← {model.measurement_names[j]}".replace("_", " ")
        for K, style in zip(both, (_BROAD, _NARROW), strict=True):
            value = np.where(K[:, i, j] != 0, np.abs(K[:, i, j]), np.nan)
            drawn.line(x, value, color=color, legend_label=name, **style)
    return _finished(drawn, columns=2)


def quantisation_figure(model: Model, simulation: SideBySide, state: int, bit: float | None = None) -> object:
    """Bit-exact less reference, one state of all tracks, with the last bit of its format if that is known."""
    error = (simulation.exact.x - simulation.reference.x)[..., state]
    step, track = np.nonzero(~np.isnan(error))
    found = _thinned(np.stack([step, error[step, track]], axis=-1))
    unit = model.state_units[state]
    drawn = _figure("step", with_unit(f"error of {model.state_names[state]}", unit), height=220)
    if bit is not None:
        span = [float(step.min(initial=0)), float(step.max(initial=1))]
        for sign in (-1, 1):
            drawn.line(span, [sign * bit] * 2, color=ORANGE, line_dash="dashed", legend_label="± last bit")
    drawn.scatter(
        *found.T, size=3, color=BLUE, alpha=0.6, line_color=None, legend_label="bit-exact − reference"
    )
    return _finished(drawn)


def bars_figure(bars: Sequence[Bar], what: str) -> object:
    """Work over clock cycles; ``what`` it is, a word for it."""
    groups = list(dict.fromkeys(bar.work.group for bar in bars))
    count = 1 + max((bar.lane for bar in bars), default=0)
    height = int(min(900, max(260, 90 + 9 * count)))
    drawn = _figure("clock cycle", "", height=height)
    for group, color in zip(groups, _colors(len(groups)), strict=True):
        mine = [bar for bar in bars if bar.work.group == group]
        source = ColumnDataSource(
            {
                "left": [bar.left + 0.04 for bar in mine],
                "right": [bar.right - 0.04 for bar in mine],
                "top": [bar.lane + 0.08 for bar in mine],
                "bottom": [bar.lane + 0.92 for bar in mine],
                "origin": [bar.work.origin for bar in mine],
                "kind": [bar.work.kind for bar in mine],
                "cycles": [_cycles(bar.work.start, bar.work.end) for bar in mine],
            }
        )
        drawn.quad("left", "right", "top", "bottom", source=source, color=color, line_color=None,
                   legend_label=group)  # fmt: skip
    drawn.y_range = Range1d(count + 0.3, -0.3)
    drawn.yaxis.visible = False
    drawn.ygrid.visible = False
    drawn.add_tools(HoverTool(tooltips=[("", "@origin"), (what, "@kind"), ("cycles", "@cycles")]))
    return _finished(drawn)


def _cycles(start: int, end: int) -> str:
    return str(start) if start == end else f"{start} to {end}"


def _measured(model: Model, j: int) -> str:
    seen = model.seen.get(j)
    unit = model.state_units[seen.state] if seen is not None and seen.factor == 1 else ""
    return with_unit(f"innovation of {model.measurement_names[j]}", unit)


def _axis(simulation: SideBySide) -> tuple[NDArray[np.int64], int, Array, str]:
    """Rows spread evenly over the featured track, the track, and the times or steps of the rows."""
    track = featured(simulation)
    rows = np.flatnonzero(simulation.plots.active[:, track])
    rows = rows[:: 1 + len(rows) // _POINTS]
    time = simulation.plots.time
    if time is not None and np.isfinite(time[rows, track]).all():
        return rows, track, time[rows, track], "time (s)"
    return rows, track, rows.astype(np.float64), "step"


def _thinned(path: Array) -> Array:
    return path[:: 1 + len(path) // _POINTS]


def _colors(count: int) -> Iterator[str]:
    return iter([SERIES[k % len(SERIES)] for k in range(count)])


def _figure(x: str, y: str, height: int, **more: object) -> bokeh_figure:
    return bokeh_figure(
        x_axis_label=x,
        y_axis_label=y,
        height=height,
        sizing_mode="stretch_width",
        tools=_TOOLS,
        active_drag=None,
        **more,
    )


def _finished(drawn: bokeh_figure, columns: int | None = None) -> bokeh_figure:
    """Quiet axes on no background, so that the page's own shows, light or dark."""
    drawn.toolbar.logo = None
    drawn.toolbar.autohide = True
    drawn.background_fill_alpha = drawn.border_fill_alpha = 0
    drawn.outline_line_color = None
    drawn.grid.grid_line_color = _GRID
    for axis in drawn.axis:
        axis.axis_line_color = axis.major_tick_line_color = _GRID
        axis.minor_tick_line_color = None
        axis.formatter = CustomJSTickFormatter(code=_TICK)
        axis.major_label_text_color = axis.axis_label_text_color = _INK
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = "12px"
    for legend in list(drawn.legend):
        drawn.center.remove(legend)
        drawn.add_layout(legend, "above")
        legend.background_fill_alpha = 0
        legend.border_line_color = None
        legend.label_text_color = _INK
        legend.label_text_font_size = "12px"
        legend.click_policy = "hide"
        legend.orientation = "horizontal"
        legend.spacing, legend.padding, legend.margin = 14, 2, 0
        legend.ncols = columns or "auto"
    return drawn
