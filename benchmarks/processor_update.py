"""Clocks of a full update with three states and three measurements, by the ways to build the core.

    python benchmarks/processor_update.py [--rows 20]

F, H and R are dense, so that nothing of the seven steps folds away. Clocks of a row as the instruction-set
simulator counts them, with what is read and put out and without. The bound is that of the multipliers: each
is busy in every clock, and nothing waits for anything.
"""

import argparse

import numpy as np

from kalmanhdl.algorithm import Conventional
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.compiler.generate import rows_read, source, tokens
from kalmanhdl.processor.compiler.trace import traced
from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION, Core
from kalmanhdl.processor.instructions import Opcode, decode
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.simulator import Machine
from kalmanhdl.processor.timing import passes_of

MODEL = linear_model(
    [[0.9, 0.1, 0.05], [0.02, 0.8, 0.2], [0.1, 0.03, 0.7]],
    [[1.0, 0.2, 0.1], [0.3, 1.0, 0.2], [0.1, 0.4, 1.0]],
    np.eye(3) + 0.1,
    np.diag([2.0, 3.0, 4.0]),
    initial=given([1, 2, 3], 4 * np.eye(3)),
)
PAPER_OPERATIONS = 11 + 5 + 3 + 1
"""Multiplications, additions, transpositions and the inversion of one update, as the paper counts them."""
IO = ("READ", "WRITE", "JUMP_DRDY", "JUMP_ACK")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=20)
    rows = parser.parse_args().rows
    paper = PAPER_OPERATIONS * CLOCKS_PER_INSTRUCTION
    print(f"the paper's operations at eight clocks: {PAPER_OPERATIONS}, {paper} clocks")
    for units in (0, 1, 3, 9):
        core = Core(form=Fixed(width=32, fraction=18), extended=True, units=units)
        text = source(traced(MODEL, Conventional(), 3), core)
        whole = clocks(text, core, rows)
        alone = clocks(without_io(text), core, rows)
        name = f"{core.multipliers} multipliers" if units else "eight clocks an instruction"
        bound = f"; bound of the multipliers {bound_of(text, core):.1f}" if units else ""
        share = f"{100 * alone / paper:.0f} % of the paper's"
        print(f"{name}: {alone:g} clocks, {share}; with input and output {whole:g}{bound}")


def clocks(text, core, rows):
    """Clocks from one pass of the step to the next."""
    program = assemble(text, core)
    rng = np.random.default_rng(1)
    filter_ = traced(MODEL, Conventional(), 3)
    read = tokens(filter_, core, rows_read(core, rng.normal(size=(rows + 3, 3))))
    machine = Machine(core, *bench(core, read))
    machine.load(program.words)
    begins = []
    while len(begins) < rows + 1:
        if machine.retire().address == program.labels["step"]:
            begins.append(machine.clock)
    return (begins[-1] - begins[1]) / (rows - 1)


def without_io(text):
    """A program's source without what is read and put out; labels stay."""
    kept = []
    for line in text.splitlines():
        label, words = line.split(":", 1) if ":" in line.split("--")[0] else ("", line)
        if words.split()[:1] and words.split()[0] in IO:
            kept.append(f"{label}:" if label else "")
        else:
            kept.append(line)
    return "\n".join(kept)


def bound_of(text, core):
    """Products of a step over multipliers."""
    program = assemble(without_io(text), core)
    step = program.words[program.labels["step"] :]
    count = 0
    for word in step:
        for tasks in passes_of(Opcode(decode(word).opcode), core):
            count += sum(len(task.terms) for task in tasks)
    return count / core.multipliers


if __name__ == "__main__":
    main()
