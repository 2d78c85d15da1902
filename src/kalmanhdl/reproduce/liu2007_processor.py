"""The filters of liu2007 as programs of one matrix processor: n = m = 4, 16 bits.

Beside the clocks of Liu, Bouganis & Cheung 2007, table 2. The model is the dense one of ``liu2007``.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

from kalmanhdl.algorithm import BiermanThornton, Taylor
from kalmanhdl.design import Design, Processor, Target
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.processor.build import implemented
from kalmanhdl.processor.checks import drawn_rows, verified
from kalmanhdl.processor.fit import Fitted, fitted
from kalmanhdl.processor.step import Step, step_of
from kalmanhdl.processor.verilog import core_verilog
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.liu2007 import chosen_model
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.toolchain.nextpnr import Implementation

ALGORITHMS = {"Taylor about I": Taylor(about="identity"), "Bierman-Thornton": BiermanThornton()}
MULTIPLIERS = (0, 4, 16, 64)
"""By core: eight clocks an instruction, and pipelined on N, N^2 and N^3."""
PLACED = 16
STEPS = 500
_COLUMNS = (
    *("filter", "clocks a step", "instructions", "words", "MHz", "ns a step", "M steps/s"),
    *("multipliers", "LUTs", "registers", "block RAMs"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A filter on a core, and a step of it."""

    name: str
    fit: Fitted
    step: Step


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """The programs; of those of the core that is placed, values of simulator and Verilog that were equal."""

    programs: tuple[Program, ...]
    steps: int
    values: int
    placed: Implementation | None


def program(name: str, multipliers: int) -> Program:
    """A filter of ``ALGORITHMS`` on a core of 16 bits."""
    with warnings.catch_warnings():
        # The paper expands about I, whether that converges or not.
        warnings.simplefilter("ignore")
        design = Design(
            name="liu2007",
            model=chosen_model(),
            algorithm=ALGORITHMS[name],
            target=Target(device="ecp5-85k", grade=8, seeds=1),
            processor=Processor(width=16, multipliers=multipliers),
        )
        fit = fitted(design)
    return Program(name=name, fit=fit, step=step_of(fit))


def figures(progress: Progress = silent, *, steps: int = STEPS, place: bool = True) -> Figures:
    """Both filters on every core; on that of ``PLACED`` multipliers verified, and it placed with one seed.

    Raises ToolError, VerificationError.
    """
    progress("the filters as programs")
    programs = tuple(program(name, count) for count in MULTIPLIERS for name in ALGORITHMS)
    mine = [one for one in programs if one.fit.core.pipelined and one.fit.core.multipliers == PLACED]
    core = mine[0].fit.core
    assert all(one.fit.core == core for one in mine), "the filters need different cores"
    verilog, values = core_verilog(core), 0
    for one in mine:
        progress(f"{one.name}: verifying {steps} steps of its program")
        runs = verified(one.fit, verilog, (), drawn_rows(one.fit, steps), steps)
        values += sum(run.values for run in runs)
    placed = None
    if place:
        progress("placing and routing the core")
        placed = implemented(mine[0].fit, verilog)[0]
    return Figures(programs=programs, steps=steps, values=values, placed=placed)


def reproduction(found: Figures) -> Reproduction:
    """The paper's rows, then the programs, and what the placed core makes of them."""
    printed = [row for row in facts("liu2007")["hardware"]["rows"] if "clocks a step" in row["figures"]]
    quoted = [(row["name"], *(row["figures"].get(each, "") for each in _COLUMNS[1:])) for row in printed]
    return Reproduction(
        title="Liu, Bouganis & Cheung 2007: both filters as programs of one matrix processor, n = m = 4",
        columns=_COLUMNS,
        rows=(*quoted, *(_row(one, found.placed) for one in found.programs)),
        notes=_notes(found),
        charts={},
    )


def _row(one: Program, placed: Implementation | None) -> tuple[str, ...]:
    core, step = one.fit.core, one.step
    how = "pipelined" if core.pipelined else "eight clocks an instruction"
    name = f"16 bits, {one.name}, {how}"
    count = str(core.multipliers)
    cells: Sequence[str] = ("", "", "", count, "", "", "")
    if placed is not None and core.pipelined and core.multipliers == PLACED:
        ns = 1000 * step.clocks / placed.fmax_mhz
        cells = (f"{placed.fmax_mhz:.1f}", f"{ns:.0f}", f"{1000 / ns:.3g}", count)
        cells = (*cells, str(placed.luts), str(placed.ffs), str(placed.block_rams))
    return name, f"{step.clocks:g}", f"{step.instructions:g}", str(len(one.fit.program.words)), *cells


def _notes(found: Figures) -> tuple[str, ...]:
    core = found.programs[0].fit.core
    notes = [
        "Clocks are those of the instruction-set simulator, what is read and put out with them, with "
        "peripherals that never wait; a step of one track begins when the last one has ended.",
        f"On the core of {PLACED} multipliers {found.steps} steps of either program were held against its "
        f"Verilog: {found.values} values, none differed. All numbers are {core.form}.",
    ]
    if found.placed is not None:
        one = found.placed
        notes.append(
            f"That core is placed once for both, on {one.device} grade {one.grade}, seed {one.seed}: "
            f"{one.multipliers} multiplier blocks, with those of its reciprocal."
        )
    return tuple(notes)
