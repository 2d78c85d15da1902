"""Make uav_radar.csv: what a ground radar would measure of the measured track uav/UAV_Rot.csv.

    python designs/data/make_uav_radar.py [FILE, - for standard output]

The GPS positions are the truth, as east, north and up of the radar; its range, azimuth (from east towards
north) and elevation come with Gaussian noise of the stated deviations, from a fixed seed.
"""

import csv
import math
import random
import sys
from pathlib import Path

HERE = Path(__file__).parent
EARTH_RADIUS_M = 6378137.0
# The radar, from where the track begins: beside the middle of the track, on the ground.
EAST_M, NORTH_M = -900.0, -800.0
SIGMAS = (3.14, math.radians(0.6), math.radians(math.sqrt(10.0)))
SEED = 2019
COLUMNS = ("time", "range", "azimuth", "elevation", "truth_east", "truth_north", "truth_up")


def positions() -> list[tuple[float, float, float, float]]:
    """Time (s) and east, north and up of the radar (m)."""
    with (HERE / "uav" / "UAV_Rot.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = ("timestamp", "latitude", "longitude", "altitude (m)")
    begin, latitude, longitude, altitude = (float(rows[0][name]) for name in names)
    level = EARTH_RADIUS_M * math.cos(math.radians(latitude))
    found = []
    for row in rows:
        t, lat, lon, height = (float(row[name]) for name in names)
        east = math.radians(lon - longitude) * level - EAST_M
        north = math.radians(lat - latitude) * EARTH_RADIUS_M - NORTH_M
        found.append((t - begin, east, north, height - altitude))
    return found


def main() -> None:
    chance = random.Random(SEED)
    lines = [",".join(COLUMNS)]
    for t, east, north, up in positions():
        level = math.hypot(east, north)
        seen = (math.hypot(level, up), math.atan2(north, east), math.atan2(up, level))
        distance, azimuth, elevation = (
            value + sigma * chance.gauss(0, 1) for value, sigma in zip(seen, SIGMAS, strict=True)
        )
        plots = f"{distance:.3f},{azimuth:.6f},{elevation:.6f}"
        lines.append(f"{t:.1f},{plots},{east:.3f},{north:.3f},{up:.3f}")
    text = "".join(line + "\n" for line in lines)
    path = sys.argv[1] if len(sys.argv) > 1 else str(HERE / "uav_radar.csv")
    if path == "-":
        sys.stdout.write(text)
    else:
        Path(path).write_text(text, newline="")


if __name__ == "__main__":
    main()
