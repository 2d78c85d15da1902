"""The processor's simulator against its Verilog: every instruction on random operands, and random programs.

    python benchmarks/processor.py [--operands 100000] [--programs 10000] [--only pipelined]

Each is shared out over cores of several word lengths, roundings and overflows, with eight clocks an
instruction and pipelined; ``--only`` takes those whose name has this word. ``--only floats`` takes the cores
of floating-point numbers, whose simulators are not optimised: compilers take minutes for them.
"""

import argparse
import random
import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests" / "processor"))

from conftest import CORES
from random_programs import every_instruction, number, random_peripherals, random_program

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import Function
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.rtl_simulation import Peripherals, RtlSimulation
from kalmanhdl.processor.simulator import Machine
from kalmanhdl.processor.verification import compare
from kalmanhdl.processor.verilog import core_verilog

SLICE = 2000
HALF, SINGLE = Float(5, 10), Float(8, 23)
ALL = {
    **CORES,
    "32 bits": Core(form=Fixed(width=32, fraction=24), program_words=256),
    "pipelined, N^3, the paper's instructions": Core(
        form=Fixed(width=8, fraction=4), rounding=Rounding.FLOOR, overflow=Overflow.WRAP, units=9
    ),
    "floats, half": Core(form=HALF, matrices=64, extended=True),
    "floats, single, 2 by 2": Core(form=SINGLE, matrices=64, size=2, extended=True),
    "floats, single, pipelined, N": Core(form=SINGLE, matrices=64, extended=True, units=1),
    "floats, half, pipelined, N^2": Core(form=HALF, matrices=64, extended=True, units=3),
    "floats, half, 5 by 5, pipelined, N": Core(form=HALF, matrices=64, size=5, extended=True, units=1),
    "floats, half, pipelined, functions": Core(
        form=HALF,
        matrices=64,
        size=2,
        extended=True,
        units=2,
        functions=(Function.SINE, Function.COSINE, Function.SQUARE_ROOT),
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--operands", type=int, default=100_000)
    parser.add_argument("--programs", type=int, default=10_000)
    parser.add_argument("--only", default="")
    asked = parser.parse_args()
    chosen = {name: core for name, core in ALL.items() if asked.only in name}
    if not asked.only:
        chosen = {name: core for name, core in chosen.items() if not core.floating}
    share = len(chosen)
    for index, (name, core) in enumerate(chosen.items()):
        with RtlSimulation(core, core_verilog(core), optimised=not core.floating) as rtl:
            machine = Machine(core, *bench(core, ()))
            begin, rng = time.perf_counter(), random.Random(index)
            operands = -(-asked.operands // share)
            equal = on_operands(core, rtl, machine, rng, operands)
            programs = -(-asked.programs // share)
            equal += on_programs(core, rtl, machine, rng, programs)
        seconds = time.perf_counter() - begin
        print(
            f"{name}: every instruction on {operands} operands, {programs} programs: {equal} values equal, "
            f"0 mismatches, {seconds:.0f} s",
            flush=True,
        )


def on_operands(core, rtl, machine, rng, count):
    words, equal = every_instruction(core), 0
    for first in range(0, count, SLICE):
        sets = min(SLICE, count - first)
        tokens = [number(rng, core) for _ in range(2 * core.elements * sets)]
        equal += compare(core, rtl, machine, words, Peripherals(tokens=tokens), len(words) * sets)
    return equal


def on_programs(core, rtl, machine, rng, count):
    equal = 0
    for _ in range(count):
        words = random_program(rng, core, rng.randint(2, 60))
        equal += compare(core, rtl, machine, words, random_peripherals(rng, core, 20), rng.randint(20, 150))
    return equal


if __name__ == "__main__":
    main()
