"""Pictures of what was explored: bits against error, and error against word length."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kalmanhdl.explore.evaluator import Objective, Point
from kalmanhdl.explore.search import Found
from kalmanhdl.explore.sweep import Row
from kalmanhdl.report.palette import BLUE, ORANGE, SERIES
from kalmanhdl.report.pictures import INK, TITLE, new_axes, save


def save_front(found: Found, name: str, path: Path) -> None:
    """The best error for every cost that was tried; the suffix of the path chooses PNG or SVG."""
    figure, axes = new_axes(7.0, 4.2)
    by_error = found.unseen is not None

    def height(point: Point) -> float:
        return 100 * point.error if by_error else point.shift

    front = [point for point in found.front if height(point) > 0]
    axes.plot([p.cost for p in front], [height(p) for p in front], ".-", color=BLUE, label="best found")
    chosen, uniform = found.point, found.uniform_point
    axes.plot(chosen.cost, height(chosen), "o", color=ORANGE, label="chosen")
    label = f"uniform, {found.uniform} bits a word"
    axes.plot(uniform.cost, height(uniform), "s", color=ORANGE, mfc="none", label=label)
    axes.set_yscale("log")
    axes.set_xlabel("LUTs, estimated" if found.objective is Objective.AREA else "bits of all signals")
    axes.set_ylabel("error beyond the float reference, %" if by_error else "NEES and NIS moved, half bands")
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    axes.set_title(f"{name}: number formats", **TITLE)
    save(figure, path)


def save_sweep(rows: Sequence[Row], name: str, path: Path) -> None:
    """The squared error against word length, broken ones as crosses; the suffix chooses PNG or SVG."""
    figure, axes = new_axes(7.0, 4.2)
    for k, kind in enumerate(dict.fromkeys(row.algorithm for row in rows)):
        mine, colour = [row for row in rows if row.algorithm == kind], SERIES[k % len(SERIES)]
        axes.plot([r.width for r in mine], [r.squared_error for r in mine], "-", color=colour, label=kind)
        for marks, broken in ((".", False), ("x", True)):
            some = [r for r in mine if bool(r.broken) is broken]
            axes.plot([r.width for r in some], [r.squared_error for r in some], marks, color=colour)
    least = min(row.float_squared_error for row in rows)
    axes.axhline(least, color=INK, linewidth=0.8, linestyle=":", label="float")
    finite = [r.squared_error for r in rows if np.isfinite(r.squared_error) and r.squared_error > 0]
    if finite:
        axes.set_yscale("log")
    axes.set_xlabel("word length, bits")
    axes.set_ylabel("mean squared error")
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    axes.set_title(f"{name}: accuracy against word length (x: broken)", **TITLE)
    save(figure, path)
