"""The filters of liu2007 (n = m = 4, 16 bits) on the matrix processor, beside hardware of their own.

    python benchmarks/liu2007_processor.py [--no-place] [--steps 500]

Both filters are programs of one core, which is verified with each and placed once, with one seed. Clocks of a
step are the instruction-set simulator's, input and output included, with peripherals that never wait. Hardware
of the filters' own: ``designs/liu2007_*.toml``. The paper's clocks are those of its table 2.
"""

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

from kalmanhdl.design import Architecture, Design, Processor
from kalmanhdl.processor.build import implemented
from kalmanhdl.processor.checks import drawn_rows, verified
from kalmanhdl.processor.fit import fitted
from kalmanhdl.processor.step import step_of
from kalmanhdl.processor.verilog import core_verilog

DESIGNS = Path(__file__).parents[1] / "designs"
NAMES = ("liu2007_taylor", "liu2007_bierman_thornton")
MULTIPLIERS = (0, 4, 16, 64)
PLACED = 16


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--no-place", action="store_true")
    parser.add_argument("--steps", type=int, default=500)
    asked = parser.parse_args()
    # The paper expands about I, which the design files warn of.
    warnings.simplefilter("ignore")
    for multipliers in MULTIPLIERS:
        for name in NAMES:
            fit = on_processor(name, multipliers)
            step = step_of(fit)
            print(
                f"{name}, {multipliers} multipliers: {step.clocks:g} clocks, {step.instructions:g} instructions, "
                f"{len(fit.program.words)} words, {fit.core.form}",
                flush=True,
            )
    fits = [on_processor(name, PLACED) for name in NAMES]
    assert len({fit.core for fit in fits}) == 1, "the filters need different cores"
    verilog = core_verilog(fits[0].core)
    for fit in fits:
        prompt, slow = verified(fit, verilog, (), drawn_rows(fit, asked.steps), asked.steps)
        print(
            f"{fit.design.name}: {prompt.steps} steps, {prompt.outputs} outputs, "
            f"{prompt.values + slow.values} values of simulator and Verilog equal, 0 mismatches",
            flush=True,
        )
    if asked.no_place:
        return
    placed = implemented(fits[0], verilog)[0]
    print(
        f"the core on {placed.device} grade {placed.grade}, seed {placed.seed}: {placed.fmax_mhz:.1f} MHz, "
        f"{placed.luts} LUTs, {placed.ffs} registers, {placed.multipliers} multiplier blocks, "
        f"{placed.block_rams} block RAMs"
    )
    for fit in fits:
        clocks = step_of(fit).clocks
        print(f"{fit.design.name}: {clocks:g} clocks, {1e3 * placed.fmax_mhz / clocks:.0f} thousand updates/s")


def on_processor(name, multipliers):
    """A design of the repository as a program."""
    design = Design.load(DESIGNS / f"{name}.toml")
    target = replace(design.target, seeds=1)
    processor = Processor(width=16, multipliers=multipliers)
    return fitted(replace(design, architecture=Architecture(), processor=processor, target=target))


if __name__ == "__main__":
    main()
