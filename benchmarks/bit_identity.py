"""Engine and Verilog, bit for bit, for every fixed-point algorithm at two to four states.

One line a design: what it is, steps and bits compared, clocks a second of the simulator, and seconds.
Those of many operations take minutes to compile; ``--only 'extended|_2$'``, a regular expression, takes some.
Run: ``python benchmarks/bit_identity.py --steps 100000``.
"""

import argparse
import re
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from every_algorithm import every_algorithm
from kalmanhdl.design import Design
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.pipeline import compile_design, verify


def _line(name: str, make: Callable[[], Design], steps: int) -> tuple[str, bool]:
    """What is printed of one design, and whether anything was wrong."""
    begin = time.perf_counter()
    try:
        hardware = compile_design(make())
        runs = verify(hardware, steps)
    except KalmanhdlError as error:
        return f"{name}: {type(error).__name__}: {error}", True
    plan, wrong = hardware.plan, sum(run.mismatches for run in runs)
    speed = sum(run.cycles for run in runs) / sum(run.cycles / run.cycles_per_second for run in runs)
    parts = [
        f"{name}: {plan.channels} channels, interval {plan.interval}, latency {plan.latency}",
        f"{sum(run.steps for run in runs)} steps, {sum(run.bits for run in runs)} bits, {wrong} mismatches",
        f"{speed / 1e6:.3f} M clocks/s, {time.perf_counter() - begin:.0f} s",
    ]
    return "; ".join(parts), wrong > 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--only", default="", help="designs whose names match")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    failed = 0
    for name, make in every_algorithm().items():
        if re.search(asked.only, name):
            line, wrong = _line(name, make, asked.steps)
            failed += wrong
            print(line, flush=True)
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
