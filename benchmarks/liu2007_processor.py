"""The filters of liu2007 (n = m = 4, 16 bits) as programs of one matrix processor.

    python benchmarks/liu2007_processor.py [--no-place] [--steps 500]

The last table of ``kalmanhdl reproduce liu2007`` alone. Hardware of the filters' own: designs/liu2007_*.toml.
"""

import argparse
import sys

from kalmanhdl.reproduce.liu2007_processor import STEPS, figures, reproduction
from kalmanhdl.tables import reproduction_table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--no-place", action="store_true")
    parser.add_argument("--steps", type=int, default=STEPS)
    asked = parser.parse_args()
    found = figures(lambda line: print(line, file=sys.stderr), steps=asked.steps, place=not asked.no_place)
    print(reproduction_table(reproduction(found)))


if __name__ == "__main__":
    main()
