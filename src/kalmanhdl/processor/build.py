"""A design with a processor, the whole line down: program, core, test bench, verification, figures."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import VerificationError
from kalmanhdl.model.model import Array
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.folder import contents, off_reference
from kalmanhdl.processor.compiler.generate import rows_read, tokens
from kalmanhdl.processor.core import CLOCKS_PER_INSTRUCTION
from kalmanhdl.processor.fit import Fitted, begun, tracks
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.rtl_simulation import Peripherals, RtlSimulation
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.verification import compare
from kalmanhdl.processor.verilog import TOP
from kalmanhdl.target import device
from kalmanhdl.toolchain.nextpnr import Implementation

_MOST_INSTRUCTIONS = 1_000_000_000
_SLOW_ROWS = 20
_STEPS_OF_A_TRACK = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """A verification: rows of the filter, and values of engine, simulator and Verilog that were equal."""

    peripherals: str
    steps: int
    outputs: int
    values: int
    clocks: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Built:
    """What a build made: files by name, figures, and the seconds that it took."""

    fit: Fitted
    files: Mapping[str, str]
    step_clocks: float
    step_instructions: float
    off_reference: Array | None = None
    checked: tuple[Checked, ...] = ()
    placed: tuple[Implementation, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)


def build(
    fit: Fitted,
    z: Array | None,
    *,
    steps: int,
    place: bool,
    progress: Callable[[str], None],
) -> Built:
    """Everything of a design's program. z (steps, m): measurements of one track in the model's units.

    ``steps`` rows, of the data and then of tracks drawn from the model, are held against the Verilog; 0
    leaves that out. ``place``: also synthesis, place and route. Raises ToolError, VerificationError.
    """
    seconds: dict[str, float] = {}
    rows = None if z is None else begun(z / fit.scaling.measurement, fit.model)
    drawn = _drawn(fit, max(steps, 1))
    begin = time.perf_counter()
    progress("writing program and Verilog")
    files = dict(contents(fit.filter_, fit.core, drawn[0] if rows is None else rows))
    seconds["rtl"] = time.perf_counter() - begin
    found: list[Checked] = []
    if steps:
        begin = time.perf_counter()
        progress(f"verifying {steps} steps: engine, instruction-set simulator, Verilog")
        found = list(verified(fit, files["core.v"], [] if rows is None else [rows], drawn, steps))
        seconds["verify"] = time.perf_counter() - begin
    placed: tuple[Implementation, ...] = ()
    if place:
        begin = time.perf_counter()
        progress("synthesising, placing and routing")
        placed = _placed(fit, files["core.v"])
        seconds["place_and_route"] = time.perf_counter() - begin
    off = None
    if rows is not None:
        off = off_reference(fit.filter_, fit.algorithm, fit.core, rows) * fit.scaling.state
    clocks, instructions = step_costs(fit)
    return Built(
        fit=fit,
        files=files,
        step_clocks=clocks,
        step_instructions=instructions,
        off_reference=off,
        checked=tuple(found),
        placed=placed,
        seconds=seconds,
    )


def verified(
    fit: Fitted, verilog: str, data: list[Array], drawn: list[Array], steps: int
) -> tuple[Checked, ...]:
    """Engine, instruction-set simulator and Verilog on the data and on drawn tracks, bit for bit.

    Raises VerificationError at the first difference, with what differs.
    """
    machine = Machine(fit.core, *bench(fit.core, ()))
    prompt = Checked(peripherals="prompt", steps=0, outputs=0, values=0, clocks=0)
    with RtlSimulation(fit.core, verilog, optimised=False) as rtl:
        for z in (*data, *drawn):
            if prompt.steps >= steps:
                break
            prompt = _joined(prompt, _one(fit, rtl, machine, z[: steps - prompt.steps], None))
        slow = _one(fit, rtl, machine, drawn[0][:_SLOW_ROWS], np.random.default_rng(1))
    return prompt, slow


def _one(
    fit: Fitted, rtl: RtlSimulation, machine: Machine, z: Array, slow: np.random.Generator | None
) -> Checked:
    """One track, from the loading of the program on."""
    core = fit.core
    rows = rows_read(core, z)
    engine = Engine(fit.filter_, core)
    wanted = [number for row in rows for number in engine.step(row)]
    read = tokens(fit.filter_, core, rows)
    machine.source, machine.sink = bench(core, read)
    machine.load(fit.program.words)
    done = run(machine, _MOST_INSTRUCTIONS)
    _compare_outputs(fit, wanted, done.sent)
    clocks = machine.clock
    values = compare(core, rtl, machine, fit.program.words, _peripherals(read, slow), done.instructions)
    return Checked(
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
    return Checked(
        peripherals=first.peripherals,
        steps=first.steps + second.steps,
        outputs=first.outputs + second.outputs,
        values=first.values + second.values,
        clocks=first.clocks + second.clocks,
    )


def _drawn(fit: Fitted, steps: int) -> list[Array]:
    """Tracks drawn from the model, so many steps in all or more, in the units of the hardware."""
    length = min(_STEPS_OF_A_TRACK, max(steps, _SLOW_ROWS))
    count = -(-2 * steps // length) + 1
    plots = simulated(fit.design.model, fit.design.fixed_point.coast, length, count)
    return [z for z in (begun(each, fit.model) for each in tracks(plots, fit.scaling)) if len(z)]


def step_costs(fit: Fitted, rows: int = 12) -> tuple[float, float]:
    """Clocks and instructions from one step to the next, with peripherals that never make it wait."""
    z = np.zeros((rows + fit.filter_.points, fit.model.m))
    read = tokens(fit.filter_, fit.core, rows_read(fit.core, z))
    machine = Machine(fit.core, *bench(fit.core, read))
    machine.load(fit.program.words)
    begins: list[tuple[int, int]] = []
    count = 0
    while len(begins) < rows:
        done = machine.retire()
        count += 1
        if done.address == fit.program.labels["step"]:
            begins.append((done.clock, count))
    first, last = begins[2], begins[-1]
    passes = len(begins) - 3
    return (last[0] - first[0]) / passes, (last[1] - first[1]) / passes


def _placed(fit: Fitted, verilog: str) -> tuple[Implementation, ...]:
    from kalmanhdl.toolchain.nextpnr import best, place_and_route
    from kalmanhdl.toolchain.yosys import synthesise_ecp5

    target = fit.design.target
    part = device(target.device, target.grade)
    netlist = synthesise_ecp5(verilog, TOP)
    wanted = 1000 / part.pipelined_period_ns
    found = place_and_route(netlist, part, range(1, target.seeds + 1), wanted)
    first = best(found)
    return (first, *(one for one in found if one is not first))


def figures(built: Built) -> dict[str, object]:
    """The report of a build as plain values."""
    fit, core = built.fit, built.fit.core
    scaling = fit.scaling
    clock = built.placed[0].fmax_mhz if built.placed else None
    return {
        "design": fit.design.name,
        "schema": 1,
        "architecture": "processor",
        "model": {"states": fit.model.n, "measurements": fit.model.m},
        "algorithm": fit.design.algorithm.kind,
        "core": {
            "size": core.size,
            "width": core.form.width,
            "fraction": core.form.fraction,
            "rounding": core.rounding.value,
            "overflow": core.overflow.value,
            "multipliers": core.multipliers,
            "pipelined": core.pipelined,
            "matrices": core.matrices,
            "program_words": core.program_words,
        },
        "program": {
            "words": len(fit.program.words),
            "matrices": len(fit.program.matrices),
            "instructions_per_step": built.step_instructions,
            "clocks_per_step": built.step_clocks,
            "clocks_per_step_at_eight_an_instruction": CLOCKS_PER_INSTRUCTION * built.step_instructions,
        },
        "units": {
            "x": scaling.state.tolist(),
            "P": np.diag(scaling.covariances()).tolist(),
            "z": scaling.measurement.tolist(),
        },
        "accuracy": None if built.off_reference is None else {"off_reference": built.off_reference.tolist()},
        "verification": [
            {
                "simulator": "cxxrtl",
                "peripherals": one.peripherals,
                "steps": one.steps,
                "outputs": one.outputs,
                "values": one.values,
                "clocks": one.clocks,
                "mismatches": 0,
            }
            for one in built.checked
        ],
        "implementation": None
        if clock is None
        else {
            "device": built.placed[0].device,
            "tool": built.placed[0].tool,
            "fmax_mhz": clock,
            "luts": built.placed[0].luts,
            "ffs": built.placed[0].ffs,
            "multipliers": built.placed[0].multipliers,
            "block_rams": built.placed[0].block_rams,
            "updates_per_second": clock * 1e6 / built.step_clocks,
        },
        "seconds": dict(built.seconds),
    }


def summary(fit: Fitted) -> list[tuple[str, str]]:
    """Rows of a table: core, program and time."""
    core, program = fit.core, fit.program
    clocks, instructions = step_costs(fit)
    mode = "pipelined" if core.pipelined else "eight clocks an instruction"
    form: Fixed = core.form
    return [
        ("core", f"{core.size} by {core.size} matrices of {form}, {core.multipliers} multipliers, {mode}"),
        ("program", f"{len(program.words)} of {core.program_words} words, {len(program.matrices)} matrices"),
        ("a step", f"{instructions:g} instructions in {clocks:g} clocks, its input and output included"),
    ]


def results(built: Built) -> list[tuple[str, str]]:
    """Rows of a table: what was verified, how far it is from double precision, what it takes of a device."""
    rows = [
        (
            "verification",
            f"{one.steps} steps, {one.outputs} outputs of engine and simulator and {one.values} values of "
            f"simulator and Verilog equal, {one.peripherals} peripherals",
        )
        for one in built.checked
    ]
    if built.off_reference is not None:
        names = built.fit.design.model.state_names
        off = ", ".join(f"{name} {each:.2g}" for name, each in zip(names, built.off_reference, strict=True))
        rows.append(("data", f"at most off double precision: {off}"))
    if built.placed:
        one = built.placed[0]
        rate = one.fmax_mhz / built.step_clocks
        rows.append(
            (
                "implementation",
                f"{one.device}: {one.fmax_mhz:.1f} MHz, {one.luts} LUTs, {one.ffs} registers, "
                f"{one.multipliers} multiplier blocks, {one.block_rams} block RAMs; {rate:.2f} M updates/s",
            )
        )
    return rows
