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
from kalmanhdl.design import Design
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.pipeline import WALKING_STEPS, Hardware, compile_design, usual_steps, verify
from planted_faults import Fault, plant

# Most faults show in few steps, in a simulator that is quickly made.
_FEW_STEPS = (2_000, WALKING_STEPS)


def _outcome(hardware: Hardware, steps: int, seed: int) -> tuple[list[str], bool]:
    """Lines that tell what was planted and found, and whether it was."""
    lines = []
    for attempt in count():
        fault = plant(hardware.verilog, seed, attempt)
        what = f"{seed:4d} {_told(fault)}: "
        for some in (few for few in _FEW_STEPS if few < steps):
            if answer := _answer(hardware, fault, some):
                return [*lines, f"{what}found in {some} steps: {answer}"], True
        if how := proof(hardware.verilog, fault.verilog, hardware.design.name, hardware.numbers.typed):
            lines.append(f"{what}changes nothing, proven by Yosys: {how}")
            continue
        if answer := _answer(hardware, fault, steps):
            return [*lines, f"{what}found in {steps} steps: {answer}"], True
        return [*lines, f"{what}NOT FOUND in {steps} steps"], False
    raise AssertionError


def _answer(hardware: Hardware, fault: Fault, steps: int) -> str:
    faulty = replace(hardware, verilog=fault.verilog)
    try:
        verify(faulty, steps, optimised=steps > _FEW_STEPS[-1])
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
    parser.add_argument("--steps", type=int, help="[default: as kalmanhdl verify takes]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    hardware = compile_design(Design.load(asked.design))
    steps = asked.steps or usual_steps(hardware)
    begin, found, same = time.perf_counter(), 0, 0
    seeds = range(asked.seed, asked.seed + asked.count)
    with ProcessPoolExecutor(asked.jobs) as pool:
        for lines, well in pool.map(partial(_outcome, hardware, steps), seeds):
            print(*lines, sep="\n", flush=True)
            found, same = found + well, same + len(lines) - 1
    print(
        f"{found} of {asked.count} faults found in at most {steps} steps; {same} more changed nothing; "
        f"{time.perf_counter() - begin:.0f} s"
    )
    sys.exit(found < asked.count)


if __name__ == "__main__":
    main()
