"""What a command says of a processor's program: rows of a table."""

from collections.abc import Sequence

from kalmanhdl.processor.build import Built
from kalmanhdl.processor.checks import Checked
from kalmanhdl.processor.fit import Fitted
from kalmanhdl.processor.step import Step
from kalmanhdl.report.processor_document import off_reference
from kalmanhdl.toolchain.nextpnr import Implementation

Rows = list[tuple[str, str]]


def summary(fit: Fitted, step: Step) -> Rows:
    """Core, program and time."""
    core, program = fit.core, fit.program
    mode = "pipelined" if core.pipelined else "eight clocks an instruction"
    return [
        (
            "core",
            f"{core.size} by {core.size} matrices of {core.form}, {core.multipliers} multipliers, {mode}",
        ),
        ("program", f"{len(program.words)} of {core.program_words} words, {len(program.matrices)} matrices"),
        (
            "a step",
            f"{step.instructions:g} instructions in {step.clocks:g} clocks, its input and output included",
        ),
    ]


def results(built: Built) -> Rows:
    """What was verified, how far it is from double precision, what it takes of a device."""
    rows = verification(built.checked)
    followed = built.followed
    if followed is not None:
        names = built.fit.given.state_names
        off = ", ".join(
            f"{name} {each:.2g}" for name, each in zip(names, off_reference(followed), strict=True)
        )
        rows.append(("data", f"at most off double precision: {off}"))
        rows += [("", counts)] if (counts := misfits(followed.saturations, followed.clipped)) else []
    return rows + implementation(built.placed, built.step)


def misfits(saturations: int, clipped: int) -> str:
    """What did not fit the core's numbers; nothing where all did."""
    found = [f"in {saturations} rows a result did not fit the core's numbers"] if saturations else []
    found += [f"{clipped} inputs were clipped"] if clipped else []
    return ", ".join(found)


def verification(checked: Sequence[Checked]) -> Rows:
    """A line a run."""
    rows = []
    for one in checked:
        what = f"{one.steps} steps, {one.outputs} outputs of engine and "
        if one.clocks is None:
            what += f"Verilog equal in {one.simulator}"
        else:
            what += (
                f"simulator and {one.values} values of simulator and Verilog equal, "
                f"{one.peripherals} peripherals"
            )
        rows.append(("verification", what))
    return rows


def implementation(placed: Sequence[Implementation], step: Step) -> Rows:
    """The best placement, if there was one."""
    if not placed:
        return []
    one = placed[0]
    text = (
        f"{one.device}: {one.fmax_mhz:.1f} MHz, {one.luts} LUTs, {one.ffs} registers, "
        f"{one.multipliers} multiplier blocks, {one.block_rams} block RAMs; "
        f"{one.fmax_mhz / step.clocks:.2f} M updates/s"
    )
    return [("implementation", text)]
