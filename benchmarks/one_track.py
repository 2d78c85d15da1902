"""One track in fixed point, placed and routed: how long a step of larger models takes.

    python benchmarks/one_track.py [--only WORD] [--seeds 1] [--show]

Constant acceleration in the plane (6 states, 2 measurements), and models of which nothing is zero, of 6 and
of 9 states and 3 measurements, on units that multiply and add; words of 16 bits. Each is built, held
against the engine, and placed on an ecp5-85k of grade 8. ``--show`` stops after the schedule, whose clock is
an estimate.
"""

import argparse
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from schedules import accelerating, dense, of

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.design import Design
from kalmanhdl.model.state_space import LinearModel
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import compile_design, implement, verify
from kalmanhdl.schedule.summary import summarise
from kalmanhdl.target import device

STEPS = 1000

CASES: dict[str, Callable[[], Design]] = {
    "6 states, constant acceleration in the plane": lambda: of(accelerating(), 16),
    "6 dense states, 3 measurements": lambda: summing(dense(6), 80.0, 24),
    "9 dense states, 3 measurements": lambda: summing(dense(9), 60.0, 32),
}


def summing(model: LinearModel, clock_mhz: float, units: int) -> Design:
    """A filter on so many units that multiply and add; constants fit a multiplier block with their sign."""
    design = of(model, 16, multiply_add=units, multiply=1, reciprocal=1)
    division = TableNewton(index_bits=7, iterations=1)
    return replace(
        design,
        numerics=FixedSpecification(width=16, classes={"constant": 17}, division=division),
        architecture=replace(design.architecture, clock_mhz=clock_mhz),
    )


def measure(name: str, design: Design, seeds: int, *, show: bool) -> None:
    """Print one row: clocks from step to step, nanoseconds, operators, area."""
    design = replace(design, target=replace(design.target, seeds=seeds))
    hardware = compile_design(design, lambda message: print(f"  {message}", file=sys.stderr))
    plan = hardware.plan
    summary = summarise(plan, device(design.target.device, design.target.grade))
    print(
        f"{name}: a step every {plan.interval} clocks, latency {plan.latency}, bound "
        f"{summary.recurrence_bound_cycles}; {plan.interval * summary.period_ns:.0f} ns expected",
        flush=True,
    )
    if show:
        return
    bits = sum(run.bits for run in verify(hardware, STEPS))
    best = implement(hardware, lambda message: print(f"  {message}", file=sys.stderr)).best
    print(
        f"  placed: {best.fmax_mhz:.1f} MHz (seed {best.seed}), "
        f"{1000 * plan.interval / best.fmax_mhz:.1f} ns a step, {best.multipliers} multipliers, "
        f"{best.luts} LUTs, {best.ffs} flip-flops; {bits} bits compared, 0 mismatches",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--show", action="store_true")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    for name, make in CASES.items():
        if asked.only in name:
            measure(name, make(), asked.seeds, show=asked.show)


if __name__ == "__main__":
    main()
