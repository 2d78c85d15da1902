"""Charts of lines over a common axis, as values and as pictures."""

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.report.palette import SERIES

Array = NDArray[np.float64]


class Style(Enum):
    """How a line is drawn: through its points, with a mark at each, dashed, or the points alone."""

    SOLID = ("-", None)
    MARKED = ("-", ".")
    DASHED = ("--", None)
    DOTS = ("none", ".")
    RINGS = ("none", "o")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A line through points x, y of equal length, in the colour of that place in the palette."""

    label: str
    x: Array
    y: Array
    color: int
    style: Style = Style.SOLID


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """Lines over one vertical axis."""

    label: str
    lines: tuple[Line, ...]
    logarithmic: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chart:
    """Panels below each other over one horizontal axis."""

    title: str
    label: str
    panels: tuple[Panel, ...]


def save_chart(chart: Chart, path: Path) -> None:
    """Draw a chart; the suffix of the path chooses PNG or SVG."""
    # Matplotlib takes long to import; who only computes does not need it.
    from kalmanhdl.report.pictures import INK, TITLE, new_panels, save

    count = len(chart.panels)
    figure, panels = new_panels(8.0, 1.8 + 2.7 * count, count)
    for axes, panel in zip(panels, chart.panels, strict=True):
        for line in panel.lines:
            dash, mark = line.style.value
            rings = line.style is Style.RINGS
            axes.plot(
                line.x,
                line.y,
                color=SERIES[line.color % len(SERIES)],
                linestyle=dash,
                linewidth=1.3,
                marker=mark,
                markersize=9 if rings else 5,
                markerfacecolor="none" if rings else None,
                label=line.label,
            )
        axes.set_ylabel(panel.label)
        axes.margins(x=0.02)
        if panel.logarithmic:
            axes.set_yscale("log")
    panels[-1].set_xlabel(chart.label)
    panels[0].legend(frameon=False, fontsize=9, labelcolor=INK)
    panels[0].set_title(chart.title, **TITLE)
    save(figure, path)
