"""Bit identity of engine and Verilog over designs drawn at random.

python benchmarks/random_models.py --count 300 --steps 300 --seed 1
"""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from kalmanhdl.errors import FormatError, KalmanhdlError
from kalmanhdl.pipeline import compile_design, verify
from random_designs import random_design


def _one(seed: int, steps: int, states: int, measurements: int) -> tuple[int, str, int, str]:
    """Build and verify one design: its seed, what it is, compared bits, and what went wrong.

    Formats drawn at random need not hold the model's own numbers: such a design is refused.
    """
    design = random_design(seed, states, measurements)
    shape = f"n={design.model.n} m={design.model.m} {design.algorithm.kind}"
    try:
        hardware = compile_design(design)
        plan = hardware.plan
        shape += f" channels={plan.channels} interval={plan.interval} latency={plan.latency}"
        # To compile an optimised simulator takes longer than the slower one runs.
        runs = verify(hardware, steps, seed=seed, optimised=False)
    except FormatError as error:
        return seed, f"{shape}: refused, {error}", 0, ""
    except KalmanhdlError as error:
        return seed, shape, 0, f"{type(error).__name__}: {error}"
    return seed, shape, sum(run.bits for run in runs), ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--states", type=int, default=6)
    parser.add_argument("--measurements", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    begin, bits, failed, refused = time.perf_counter(), 0, 0, 0
    seeds = range(asked.seed, asked.seed + asked.count)
    with ProcessPoolExecutor(asked.jobs) as pool:
        waiting = [pool.submit(_one, seed, asked.steps, asked.states, asked.measurements) for seed in seeds]
        for number, future in enumerate(as_completed(waiting), 1):
            seed, shape, compared, problem = future.result()
            bits += compared
            failed += bool(problem)
            refused += not problem and not compared
            print(
                f"{number:4d} seed {seed}: {shape}: {problem or ('equal' if compared else 'not compared')}",
                flush=True,
            )
    print(
        f"{asked.count} designs, {asked.steps} steps each of drawn tracks and of raw numbers at random: "
        f"{bits} bits compared, {failed} failed, {refused} refused, {time.perf_counter() - begin:.0f} s"
    )
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
