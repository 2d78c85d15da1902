"""DCMKF, EKF, IMM and the linear filter on a ship's radar plots, beside GNSS and two-point differencing.

The noise of the models is taken from the data of some scenarios, by moments, and tested on all others:
``sigma_range`` and ``sigma_bearing`` from what the plots' errors change by from scan to scan, which has twice
the variance of their quick part; accelerations from what the boats' true rates change by. Of the two modes
of the IMM, the quiet one has half of that acceleration, and the lively one twice.

For each design and each group of scenarios: root mean square errors of the rates, of two plots in succession,
of the float reference and of the hardware; and the mean NIS with its band of 95 %.
Run: ``python benchmarks/radar_plots.py``, or with ``--tuned-on scenario4``; ``--as-shipped`` takes the noise
of the design files.
"""

import argparse
import csv
from collections import defaultdict
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from kalmanhdl.design import Design
from kalmanhdl.pipeline import numbers_of, simulate
from kalmanhdl.report.accuracy import differencing, mean_nis, nis_inside, updated
from kalmanhdl.simulate.data import Plots, read_plots

DESIGNS = Path(__file__).parents[1] / "designs"
DATA = DESIGNS / "data"
# The designs, and which of the two tables of plots they take.
FILTERS = {"dcmkf_radar": "plane", "ekf_radar": "plane", "imm_radar": "target", "autoferry_radar": "target"}
_CONSTANTS = {
    "dcmkf_radar": ("sigma_range", "sigma_bearing", "acceleration"),
    "ekf_radar": ("sigma_range", "sigma_bearing", "acceleration"),
    "imm_radar": (
        "sigma_range",
        "sigma_bearing",
        "quiet_range",
        "quiet_bearing",
        "lively_range",
        "lively_bearing",
    ),
    "autoferry_radar": ("sigma_range", "sigma_bearing", "a_range", "a_bearing"),
}


def _columns(table: str, scenarios: list[str]) -> dict[str, dict[str, np.ndarray]]:
    """The columns of each track of some scenarios, by name, NaN where a cell is empty."""
    found: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    with (DATA / f"autoferry_radar_{table}.csv").open() as file:
        for row in csv.DictReader(file):
            track = row.pop("track")
            if track.split("_")[0] in scenarios:
                for name, cell in row.items():
                    found[track][name].append(float(cell) if cell else np.nan)
    return {track: {name: np.array(cells) for name, cells in rows.items()} for track, rows in found.items()}


def _change(
    tracks: dict[str, dict[str, np.ndarray]], name: str, *, minus: str = "", per_second: bool = False
) -> float:
    """The root mean square of what a column, or a difference of two, changes by from row to row."""
    changes = []
    for columns in tracks.values():
        values = columns[name] - columns[minus] if minus else columns[name]
        changes.append(np.diff(values) / (np.diff(columns["time"]) if per_second else 1.0))
    return float(np.sqrt(np.nanmean(np.square(np.concatenate(changes)))))


def moments(scenarios: list[str]) -> dict[str, float]:
    """The constants of all designs, from the data of some scenarios."""
    polar, plane = _columns("target", scenarios), _columns("plane", scenarios)
    north, east = (_change(plane, f"truth_{axis}_rate", per_second=True) for axis in ("north", "east"))
    a_range, a_bearing = (
        _change(polar, f"truth_{axis}_rate", per_second=True) for axis in ("range", "bearing")
    )
    return {
        "sigma_range": _change(polar, "range_plot", minus="truth_range") / np.sqrt(2),
        "sigma_bearing": _change(polar, "bearing_plot", minus="truth_bearing") / np.sqrt(2),
        "acceleration": float(np.sqrt((north**2 + east**2) / 2)),
        "a_range": a_range,
        "a_bearing": a_bearing,
        "quiet_range": a_range / 2,
        "quiet_bearing": a_bearing / 2,
        "lively_range": 2 * a_range,
        "lively_bearing": 2 * a_bearing,
    }


def _only(plots: Plots, scenarios: list[str]) -> Plots:
    """The tracks of some scenarios."""
    chosen = [k for k, track in enumerate(plots.tracks) if track.split("_")[0] in scenarios]
    arrays = {name: getattr(plots, name) for name in ("z", "u", "active", "time", "truth")}
    picked = {name: None if array is None else array[:, chosen] for name, array in arrays.items()}
    return Plots(tracks=tuple(plots.tracks[k] for k in chosen), **picked)


def _rows(name: str, constants: dict[str, float], groups: dict[str, list[str]]) -> list[list[str]]:
    used = {key: value for key, value in constants.items() if key in _CONSTANTS[name]}
    design = Design.load(DESIGNS / f"{name}.toml", used)
    model, typed = design.model, numbers_of(design)
    plots = read_plots(DATA / f"autoferry_radar_{FILTERS[name]}.csv", model)
    rows = []
    for label, scenarios in groups.items():
        simulation = simulate(design, _only(plots, scenarios), typed)
        updates = updated(simulation, model.initial.before_update)
        nis = mean_nis(simulation.exact.nis, updates)
        inside = f"{nis_inside(simulation.exact.nis, updates):.1%}"
        band = f"{nis.low:.2f} to {nis.high:.2f}"
        verdict = "inside" if nis.consistent else "below" if nis.mean < nis.low else "above"
        for k, one in enumerate(differencing(model, simulation)):
            errors = [f"{error:.4g}" for error in (one.rmse, one.rmse_reference, one.rmse_bitexact)]
            apart = f"{one.rmse_bitexact / one.rmse_reference - 1:+.2%}"
            consistency = [f"{nis.mean:.2f}", band, verdict, inside] if k == 0 else [""] * 4
            rows.append(
                [name if k == 0 else "", label, model.state_names[one.state], *errors, apart, *consistency]
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tuned-on", nargs="+", default=["scenario5"])
    parser.add_argument("--as-shipped", action="store_true")
    asked = parser.parse_args()
    everything = sorted(
        {track.split("_")[0] for track in _columns("plane", [f"scenario{k}" for k in range(2, 7)])}
    )
    constants: dict[str, float] = {}
    if asked.as_shipped:
        groups = {"all": everything} | {each: [each] for each in everything}
    else:
        constants = moments(asked.tuned_on)
        others = [each for each in everything if each not in asked.tuned_on]
        groups = {"tuned on": asked.tuned_on, "others": others} | {each: [each] for each in others}
        print("noise from", ", ".join(asked.tuned_on))
        print("  " + ", ".join(f"{key} {value:.4g}" for key, value in constants.items()))
    table = Table(
        *("design", "scenarios", "rate", "two plots", "float", "hardware", "apart"),
        *("mean NIS", "band of 95 %", "", "below limit"),
    )
    for name in FILTERS:
        for row in _rows(name, constants, groups):
            table.add_row(*row)
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
