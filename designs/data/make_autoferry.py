"""Make autoferry_radar_target.csv: the plots of single boats out of all radar plots, beside their GNSS truth.

    python designs/data/make_autoferry.py [FILE, - for standard output]

A target's plot of a scan is the plot nearest to the target's GNSS position, if it lies within GATE_M; a
scan without one is a missed measurement. So the association is done with the truth, and only the
estimation is left to the filter. A track begins at the first two scans in a row that have a plot. Tracks
with too many missed scans are left out. Everything is relative to the own ship, bearings clockwise
from north, unwrapped.
"""

import csv
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
GATE_M = 25.0
LEAST_SEEN = 0.9
HALF_WINDOW_S = 1.0
COLUMNS = (
    "track",
    "time",
    "range_plot",
    "bearing_plot",
    "truth_range",
    "truth_range_rate",
    "truth_bearing",
    "truth_bearing_rate",
)


def rows(name: str) -> Iterator[dict[str, str]]:
    with (HERE / "autoferry" / name).open(newline="") as file:
        yield from csv.DictReader(file)


def scans() -> dict[int, list[dict]]:
    """Per scenario the scans in order: time, own position, plots as north and east from the own ship."""
    found: dict[int, dict[int, dict]] = defaultdict(dict)
    for row in rows("radar.csv"):
        own = np.array([float(row["own_n_m"]), float(row["own_e_m"])])
        empty = {"time": float(row["t_s"]), "own": own, "plots": []}
        scan = found[int(row["scenario"])].setdefault(int(row["scan"]), empty)
        if row["meas_n_m"]:
            scan["plots"].append([float(row["meas_n_m"]), float(row["meas_e_m"])])
    return {scenario: [group[k] for k in sorted(group)] for scenario, group in found.items()}


def truths() -> dict[tuple[int, int], np.ndarray]:
    """Per scenario and target: time, north, east."""
    found = defaultdict(list)
    for row in rows("truth.csv"):
        sample = [float(row["t_s"]), float(row["n_m"]), float(row["e_m"])]
        found[int(row["scenario"]), int(row["target"])].append(sample)
    return {key: np.array(samples) for key, samples in found.items()}


def relative_truth(scenario: list[dict], truth: np.ndarray) -> np.ndarray:
    """Range, range rate, bearing and bearing rate of a target at each scan."""
    time = np.array([scan["time"] for scan in scenario])
    own = np.array([scan["own"] for scan in scenario])

    def at(t: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(t, truth[:, 0], truth[:, k]) for k in (1, 2)], axis=1)

    last, first = (np.clip(time + sign * HALF_WINDOW_S, truth[0, 0], truth[-1, 0]) for sign in (1, -1))
    velocity = (at(last) - at(first)) / (last - first)[:, None] - np.gradient(own, time, axis=0)
    north, east = (at(time) - own).T
    radius = np.hypot(north, east)
    rate = (north * velocity[:, 0] + east * velocity[:, 1]) / radius
    turn = (north * velocity[:, 1] - east * velocity[:, 0]) / radius**2
    return np.stack([radius, rate, np.unwrap(np.arctan2(east, north)), turn], axis=1)


def picked(scan: dict, radius: float, bearing: float) -> tuple[float, float] | None:
    """Range and bearing of the plot nearest to the truth, if one is near."""
    if not scan["plots"]:
        return None
    plots = np.array(scan["plots"])
    target = radius * np.array([np.cos(bearing), np.sin(bearing)])
    distance = np.hypot(*(plots - target).T)
    north, east = plots[distance.argmin()]
    if distance.min() > GATE_M:
        return None
    return float(np.hypot(north, east)), float(np.arctan2(east, north))


def track_rows(label: str, scenario: list[dict], truth: np.ndarray) -> list[list[str]]:
    """The rows of one target, none if it is missed too often."""
    state = relative_truth(scenario, truth)
    plots = [picked(scan, s[0], s[2]) for scan, s in zip(scenario, state, strict=True)]
    if np.mean([plot is not None for plot in plots]) < LEAST_SEEN:
        return []
    start = next(k for k in range(len(plots) - 1) if plots[k] and plots[k + 1])
    turn = 2 * np.pi
    previous, result = plots[start][1], []
    # The truth starts on the turn of the first plot.
    state[:, 2] += turn * np.round((previous - state[start, 2]) / turn)
    for scan, plot, s in list(zip(scenario, plots, state, strict=True))[start:]:
        cells = ["", ""]
        if plot is not None:
            previous = plot[1] + turn * np.round((previous - plot[1]) / turn)
            cells = [f"{plot[0]:.3f}", f"{previous:.6f}"]
        numbers = [f"{s[0]:.3f}", f"{s[1]:.4f}", f"{s[2]:.6f}", f"{s[3]:.6f}"]
        result.append([label, f"{scan['time']:.3f}", *cells, *numbers])
    return result


def main() -> None:
    all_scans = scans()
    table = [COLUMNS]
    for (scenario, target), truth in sorted(truths().items()):
        table += track_rows(f"scenario{scenario}_target{target}", all_scans[scenario], truth)
    text = "".join(",".join(row) + "\n" for row in table)
    path = sys.argv[1] if len(sys.argv) > 1 else str(HERE / "autoferry_radar_target.csv")
    if path == "-":
        sys.stdout.write(text)
    else:
        Path(path).write_text(text, newline="")


if __name__ == "__main__":
    main()
