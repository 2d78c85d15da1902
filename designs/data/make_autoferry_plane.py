"""Make autoferry_radar_plane.csv: the plots of autoferry_radar_target.csv, with the truth as north and east.

    python designs/data/make_autoferry_plane.py [FILE, - for standard output]

Bearings are brought to half a turn either side of north, as a radar gives them.
"""

import csv
import math
import sys
from pathlib import Path

HERE = Path(__file__).parent
COLUMNS = (
    *("track", "time", "range_plot", "bearing_plot"),
    *("truth_north", "truth_north_rate", "truth_east", "truth_east_rate"),
)


def converted(row: dict[str, str]) -> list[str]:
    """A row of the table from one of the other."""
    r, rate, bearing, turn = (
        float(row[f"truth_{name}"]) for name in ("range", "range_rate", "bearing", "bearing_rate")
    )
    ahead, aside = math.cos(bearing), math.sin(bearing)
    truth = (
        *(r * ahead, rate * ahead - r * turn * aside),
        *(r * aside, rate * aside + r * turn * ahead),
    )
    plot = row["bearing_plot"]
    bearing_plot = f"{math.remainder(float(plot), math.tau):.6f}" if plot else ""
    return [row["track"], row["time"], row["range_plot"], bearing_plot, *(f"{value:.4f}" for value in truth)]


def main() -> None:
    with (HERE / "autoferry_radar_target.csv").open(newline="") as file:
        table = [COLUMNS, *map(converted, csv.DictReader(file))]
    text = "".join(",".join(row) + "\n" for row in table)
    path = sys.argv[1] if len(sys.argv) > 1 else str(HERE / "autoferry_radar_plane.csv")
    if path == "-":
        sys.stdout.write(text)
    else:
        Path(path).write_text(text, newline="")


if __name__ == "__main__":
    main()
