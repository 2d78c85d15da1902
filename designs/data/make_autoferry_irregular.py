"""Make autoferry_radar_irregular.csv: the radar's plots as one sees them that looks at a boat now and then.

    python designs/data/make_autoferry_irregular.py [FILE, - for standard output]

Rows of autoferry_radar_target.csv, unchanged: those without a plot are left out, and of the others, behind a
track's first, every one with a probability of a half, from a fixed seed.
"""

import csv
import random
import sys
from pathlib import Path

HERE = Path(__file__).parent
KEPT, SEED = 0.5, 2021


def main() -> None:
    chance = random.Random(SEED)
    with (HERE / "autoferry_radar_target.csv").open(newline="") as file:
        header, *rows = list(csv.reader(file))
    plot, seen, kept = header.index("range_plot"), set(), [header]
    for row in rows:
        if row[plot] and (row[0] not in seen or chance.random() < KEPT):
            seen.add(row[0])
            kept.append(row)
    text = "".join(",".join(row) + "\n" for row in kept)
    path = sys.argv[1] if len(sys.argv) > 1 else str(HERE / "autoferry_radar_irregular.csv")
    if path == "-":
        sys.stdout.write(text)
    else:
        Path(path).write_text(text, newline="")


if __name__ == "__main__":
    main()
