"""A program on the instruction-set simulator, traced, stopped, and beside double precision."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from kalmanhdl.processor.clocks import Retired
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.fit import Fitted
from kalmanhdl.processor.follow import matrix_units
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.program import Program
from kalmanhdl.processor.reference_steps import reference_steps
from kalmanhdl.processor.shadow import Shadow
from kalmanhdl.processor.simulator import Machine, Run, run
from kalmanhdl.processor.trace import dump as dumped
from kalmanhdl.processor.trace import real, trace_line
from kalmanhdl.report.processor_compare import instruction_rows, step_lines, step_rows, store_text, worst
from kalmanhdl.tables import aligned


@dataclass(slots=True, kw_only=True)
class Execution:
    """A program on its core; ``fit`` is the design that it was compiled from, if that is known.

    It ``compares`` with double precision where it is asked to.
    """

    core: Core
    program: Program
    tokens: tuple[int, ...]
    fit: Fitted | None
    compares: bool
    machine: Machine = field(init=False)
    shadow: Shadow = field(init=False)

    def __post_init__(self) -> None:
        self.machine = Machine(self.core, *bench(self.core, self.tokens))
        self.machine.load(self.program.words)
        self.shadow = Shadow(self.core)

    def run(self, most: int, stops: frozenset[int], passes: int, trace: Callable[[str], None] | None) -> Run:
        """Run it; ``trace`` gets a line for every instruction. A stop counts when it comes up so often."""

        def watch(done: Retired) -> None:
            off = self.shadow.follow(done) if self.compares else 0.0
            if trace is not None:
                beside = f"  off {off:.2g}" if off else ""
                trace(trace_line(done, self.machine, self.program) + beside)

        sent: list[int] = []
        instructions = 0
        for _ in range(passes if stops else 1):
            done = run(self.machine, most - instructions, stops, watch)
            sent += done.sent
            instructions += done.instructions
            if not done.reason.startswith("stopped") or instructions == most:
                break
        return Run(done.reason, instructions, tuple(sent))


def printed(execution: Execution, done: Run, *, outputs: bool, dump: bool, rows: bool) -> Iterator[str]:
    """What a run has to say when it is over: numbers put out, or what is compared, and the data store."""
    core, program, machine, fit = execution.core, execution.program, execution.machine, execution.fit
    if outputs and not execution.compares:
        yield from (real(raw, core) for raw in done.sent)
    if execution.compares:
        yield aligned(instruction_rows(execution.shadow, program))
        yield from worst(execution.shadow, program)
        if fit is not None:
            steps = reference_steps(fit, execution.tokens, done.sent)
            yield "\n" + aligned(step_rows(steps))
            if rows:
                yield "\n" + aligned(step_lines(steps))
    if dump and execution.compares:
        units = {} if fit is None else matrix_units(fit.scaling, core.size)
        yield ""
        yield from store_text(machine, execution.shadow, program, units)
    elif dump:
        yield dumped(machine, program)
