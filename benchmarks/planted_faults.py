"""Faults planted in the Verilog of a design: how many does verification find?

    python benchmarks/planted_faults.py designs/lee1997.toml --count 50

A fault that verification does not find is either proven to change nothing, and another is planted in its
place, or it counts as missed.
"""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from equivalence import proof
from kalmanhdl.build import VERIFIED_STEPS
from kalmanhdl.design import Design
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.pipeline import Hardware, compile_design, verify
from planted_faults import Fault, plant

# Most faults show in few steps.
_FIRST_STEPS = 2_000
# A fault in the last bits of a sum that is rounded afterwards may show once in many thousand steps.
_MORE = 5


def _outcome(hardware: Hardware, steps: int, seed: int) -> tuple[list[str], bool, bool]:
    """Lines that tell what was planted and found; whether the default finds it; whether more steps do."""
    lines = []
    for attempt in count():
        fault = plant(hardware.verilog, seed, attempt)
        what = f"{seed:4d} {_told(fault)}: "
        for some in (_FIRST_STEPS, steps):
            if answer := _answer(hardware, fault, some):
                return [*lines, f"{what}found in {some} steps: {answer}"], True, True
        if how := proof(hardware.verilog, fault.verilog, hardware.design.name, hardware.numbers.typed):
            lines.append(f"{what}changes nothing, proven by Yosys: {how}")
            continue
        more = steps * _MORE
        if answer := _answer(hardware, fault, more):
            return [*lines, f"{what}NOT FOUND in {steps} steps; found in {more}: {answer}"], False, True
        return [*lines, f"{what}NOT FOUND, nor in {more} steps"], False, False
    raise AssertionError


def _answer(hardware: Hardware, fault: Fault, steps: int) -> str:
    try:
        # To compile an optimised simulator takes longer than the slower one runs.
        verify(replace(hardware, verilog=fault.verilog), steps, optimised=False)
    except KalmanhdlError as error:
        return str(error)[:110]
    return ""


def _told(fault: Fault) -> str:
    before, after = (" ".join(text.split()) for text in (fault.before, fault.after))
    return f"{fault.kind}, line {fault.line}: {before[:80]} -> {after[:80]}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("design", type=Path)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--steps", type=int, default=VERIFIED_STEPS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    hardware = compile_design(Design.load(asked.design))
    begin, found, eventually, same = time.perf_counter(), 0, 0, 0
    seeds = range(asked.seed, asked.seed + asked.count)
    with ProcessPoolExecutor(asked.jobs) as pool:
        for lines, by_default, at_all in pool.map(partial(_outcome, hardware, asked.steps), seeds):
            print(*lines, sep="\n", flush=True)
            found, eventually, same = found + by_default, eventually + at_all, same + len(lines) - 1
    print(
        f"{found} of {asked.count} faults found in at most {asked.steps} steps, {eventually} in at most "
        f"{asked.steps * _MORE}; {same} more changed nothing; {time.perf_counter() - begin:.0f} s"
    )
    sys.exit(found < asked.count)


if __name__ == "__main__":
    main()
