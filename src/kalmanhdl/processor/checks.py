"""Engine, instruction-set simulator and Verilog on the same tracks, bit for bit."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalmanhdl.errors import VerificationError
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import tokens
from kalmanhdl.processor.fit import Fitted, coast
from kalmanhdl.processor.follow import Rows, as_data, rows_of
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.rtl_simulation import Peripherals, RtlSimulation
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.verification import compare

_MOST_INSTRUCTIONS = 1_000_000_000
_SLOW_ROWS = 20
_STEPS_OF_A_TRACK = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """A verification: rows of the filter, and values of engine, simulator and Verilog that were equal.

    ``clocks`` of the core, where they are known.
    """

    simulator: str
    peripherals: str
    steps: int
    outputs: int
    values: int
    clocks: int | None = None


def drawn_rows(fit: Fitted, steps: int, seed: int = 1) -> tuple[Rows, ...]:
    """What the program reads of tracks drawn from the model, so many steps in all or more."""
    length = min(_STEPS_OF_A_TRACK, max(steps, _SLOW_ROWS))
    count = -(-2 * steps // length) + 1
    plots = simulated(fit.design.model, coast(fit.design), length, count, seed)
    return tuple(rows for rows in rows_of(fit.core, fit.given, fit.scaling, as_data(plots)) if rows)


def verified(
    fit: Fitted, verilog: str, data: Iterable[Rows], drawn: Sequence[Rows], steps: int
) -> tuple[Checked, ...]:
    """So many rows, of the data and then of drawn tracks, with prompt peripherals; some with slow ones.

    Raises VerificationError at the first difference, with what differs.
    """
    machine = Machine(fit.core, *bench(fit.core, ()))
    prompt = Checked(simulator="cxxrtl", peripherals="prompt", steps=0, outputs=0, values=0, clocks=0)
    with RtlSimulation(fit.core, verilog, optimised=False) as rtl:
        for rows in (*data, *drawn):
            if prompt.steps >= steps:
                break
            prompt = _joined(prompt, _one(fit, rtl, machine, rows[: steps - prompt.steps], None))
        slow = _one(fit, rtl, machine, drawn[0][:_SLOW_ROWS], np.random.default_rng(1))
    return prompt, slow


def _one(
    fit: Fitted, rtl: RtlSimulation, machine: Machine, rows: Rows, slow: np.random.Generator | None
) -> Checked:
    """One track, from the loading of the program on."""
    core = fit.core
    engine = Engine(fit.filter_, core)
    wanted = [number for row in rows for number in engine.step(row)]
    read = tokens(fit.filter_, core, rows)
    # A machine apart: that of the comparison keeps in its data store what the Verilog does, from run to run.
    alone = Machine(core, *bench(core, read))
    alone.load(fit.program.words)
    done = run(alone, _MOST_INSTRUCTIONS)
    _compare_outputs(fit, wanted, done.sent)
    clocks = alone.clock
    values = compare(core, rtl, machine, fit.program.words, _peripherals(read, slow), done.instructions)
    return Checked(
        simulator="cxxrtl",
        peripherals="slow" if slow else "prompt",
        steps=len(rows),
        outputs=len(wanted),
        values=values,
        clocks=clocks,
    )


def _compare_outputs(fit: Fitted, wanted: list[int], sent: tuple[int, ...]) -> None:
    each = len(fit.filter_.outputs)
    for k, (a, b) in enumerate(zip(wanted, sent, strict=False)):
        if a != b:
            name, element = fit.filter_.outputs[k % each]
            raise VerificationError(
                f"step {k // each}: {name}[{element}] is {b} in the simulator and {a} in the engine"
            )
    if len(wanted) != len(sent):
        raise VerificationError(f"the simulator puts out {len(sent)} numbers and the engine {len(wanted)}")


def _peripherals(read: tuple[int, ...], slow: np.random.Generator | None) -> Peripherals:
    if slow is None:
        return Peripherals(tokens=read)
    return Peripherals(
        tokens=read,
        latencies=slow.integers(0, 60, len(read)).tolist(),
        reactions=slow.integers(0, 5, len(read)).tolist(),
        sink_latencies=slow.integers(0, 60, 31).tolist(),
        sink_reactions=slow.integers(0, 5, 31).tolist(),
    )


def _joined(first: Checked, second: Checked) -> Checked:
    return replace(
        first,
        steps=first.steps + second.steps,
        outputs=first.outputs + second.outputs,
        values=first.values + second.values,
        clocks=(first.clocks or 0) + (second.clocks or 0),
    )
