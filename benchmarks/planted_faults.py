"""Faults planted in the Verilog of a design: how many does verification find?

    python benchmarks/planted_faults.py designs/lee1997.toml --count 50
"""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from kalmanhdl.build import verify_long
from kalmanhdl.design import Design
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.pipeline import Hardware, compile_design
from planted_faults import plant


def _found(hardware: Hardware, steps: int, seed: int) -> tuple[str, str]:
    fault = plant(hardware.verilog, seed)
    before, after = (" ".join(text.split()) for text in (fault.before, fault.after))
    change = f"{fault.kind}, line {fault.line}: {before} -> {after}"
    # A fault in the last bits of a sum that is rounded afterwards shows once in many thousand steps.
    for more in (steps, 50 * steps):
        try:
            verify_long(replace(hardware, verilog=fault.verilog), more, seed=seed)
        except KalmanhdlError as error:
            return change, f"in {more} steps: {error}"
    return change, ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("design", type=Path)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    hardware = compile_design(Design.load(asked.design))
    begin, missed = time.perf_counter(), 0
    seeds = range(asked.seed, asked.seed + asked.count)
    with ProcessPoolExecutor(asked.jobs) as pool:
        for number, (change, answer) in enumerate(pool.map(partial(_found, hardware, asked.steps), seeds), 1):
            missed += not answer
            print(f"{number:3d} {change[:110]}: {answer[:110] or 'NOT FOUND'}", flush=True)
    print(f"{asked.count - missed} of {asked.count} faults found, {time.perf_counter() - begin:.0f} s")
    sys.exit(missed > 0)


if __name__ == "__main__":
    main()
