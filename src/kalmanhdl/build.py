"""A whole build: the stages in their order, and the folder that keeps what they made."""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path

from kalmanhdl.closure.rounds import close
from kalmanhdl.design import Design
from kalmanhdl.design_file import dump, load
from kalmanhdl.errors import DesignError, ToolError
from kalmanhdl.numerics.floating import FloatNumbers
from kalmanhdl.numerics.integers import Numbers
from kalmanhdl.output import check_folder, new_file, new_folder
from kalmanhdl.pipeline import (
    Hardware,
    Progress,
    areas,
    bench_files,
    compile_design,
    implement,
    interface_of,
    numbers_of,
    planned,
    proof_of,
    silent,
    simulate,
    usual_steps,
    verify,
    worth_optimising,
)
from kalmanhdl.report.record import Record
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.data import Plots
from kalmanhdl.toolchain.area import AreaFigures
from kalmanhdl.toolchain.process import in_background
from kalmanhdl.toolchain.simulators import Simulator, need
from kalmanhdl.toolchain.stages import timed
from kalmanhdl.verify.compare import Verification

# Raw integers that one run of a verification keeps of each step's outputs and states, in all.
_KEPT_NUMBERS = 5_000_000


def build(
    design: Design,
    out: str | Path,
    *,
    plots: Plots | None = None,
    verify_steps: int | None = None,
    place: bool = True,
    families: bool = False,
    force: bool = False,
    progress: Progress = silent,
    simulators: tuple[Simulator, ...] = (Simulator.CXXRTL,),
    prove: bool = False,
) -> Record:
    """Take a design the whole line down and write the folder ``out``.

    With ``plots`` they are filtered by float reference and engine, side by side. ``verify_steps`` of
    the Verilog are held against the engine, the usual number of them without; 0 leaves that out, and the
    report says so. ``place``: also synthesis, place and route, anew where the design has rounds.
    ``families``: also synthesis figures on the papers' devices.
    ``force`` replaces an earlier build, ``simulators`` are those that verify. ``prove``: also what can be
    proven of the formats.

    Raises:
        DesignError: floating point is asked of a function for which there is no such hardware, or proofs
            of its formats.
        OutputError, FormatError, ScheduleError, ToolError, VerificationError. Nothing is written then.
    """
    check_folder(out, force=force)
    if prove:
        # Floating point has no formats to prove anything of.
        _ = design.fixed_point
    if verify_steps != 0:
        _need_compiler()
        need(simulators)
    prepare(place=place, progress=progress)
    seconds: dict[str, float] = {}
    hardware = compile_design(design, progress)
    # What is verified, and what the test bench is of, is what the rounds leave.
    closed = close(hardware, progress) if place and design.target.rounds else None
    if closed is not None:
        hardware = closed.hardware
    steps = usual_steps(hardware, simulators) if verify_steps is None else verify_steps
    # The engine that is made for other stages as well.
    optimised = plots is not None or (steps > 0 and worth_optimising(hardware, steps))
    with timed(seconds, "testbench", progress, "computing the vectors of the test bench"):
        bench = bench_files(hardware, optimised=optimised)
    simulation = None
    if plots is not None:
        with timed(
            seconds, "simulate", progress, "filtering the data in floats and in the hardware's integers"
        ):
            simulation = simulate(design, plots, hardware.numbers)
    proof = None
    if prove:
        with timed(seconds, "prove", progress, "proving which values never leave their formats"):
            proof = proof_of(design, hardware.numbers)
    verifications: tuple[Verification, ...] = ()
    figures: tuple[AreaFigures, ...] = ()
    # One core places and routes, the other verifies and counts: neither waits for the other.
    with in_background() as start:
        placing = start(implement, hardware, progress) if place and closed is None else None
        if steps:
            with timed(seconds, "verify", progress, f"verifying {steps} steps, Verilog against engine"):
                verifications = verify_long(hardware, steps, plots, simulators=simulators)
        if families:
            with timed(seconds, "areas", progress, "synthesising for the papers' families"):
                figures = areas(hardware)
        implemented = placing.result() if placing else closed.implemented if closed else None
    record = Record(
        hardware=hardware,
        simulation=simulation,
        verifications=verifications,
        implemented=implemented,
        closure=closed.closure if closed else None,
        areas=figures,
        proof=proof,
        seconds=seconds,
    )
    progress("writing the report")
    with new_folder(out, force=force) as folder:
        write_build(record, bench, folder)
    return record


def prepare(*, place: bool, progress: Progress) -> None:
    """Have the tools ready; where they run for the first time, this is where the minutes go."""
    from kalmanhdl.toolchain.yowasp import NEXTPNR_ECP5, YOSYS, warm_up

    warm_up((YOSYS, NEXTPNR_ECP5) if place else (YOSYS,), progress)


def write_build(record: Record, bench: Mapping[str, str], folder: Path) -> None:
    """Write everything that a build made into a folder; ``bench`` has the files of its test bench.

    Raises OSError, OutputError.
    """
    # Plots take a second to import.
    from kalmanhdl.graph.text import print_graph
    from kalmanhdl.report.writer import write_report
    from kalmanhdl.schedule.text import print_plan

    hardware = record.hardware
    dump(hardware.design, folder / _DESIGN)
    texts = {
        f"{hardware.design.name}.v": hardware.verilog,
        "graph.txt": print_graph(hardware.numbers.graph),
        "schedule.txt": print_plan(hardware.plan),
        **bench,
    }
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    write_report(record, folder)


_DESIGN = "design.toml"


def read_design(folder: Path) -> Design:
    """The design of a build folder. Raises DesignError where it is none."""
    if not (folder / _DESIGN).is_file():
        raise DesignError(f"{folder}: is no build folder: it has no {_DESIGN}")
    return load(folder / _DESIGN)


def read_build(folder: Path) -> Hardware:
    """The hardware of a build folder: the Verilog as it stands there, and the rest from its design.

    Raises:
        DesignError: the folder is none of a build, or its files cannot be read.
    """
    design = read_design(folder)
    verilog = verilog_text(folder, design)
    typed, plan = planned_design(design)
    return Hardware(
        design=design, numbers=typed, plan=plan, interface=interface_of(design, plan), verilog=verilog
    )


def verilog_text(folder: Path, design: Design) -> str:
    """The Verilog as it stands in a build folder. Raises DesignError where it cannot be read."""
    path = verilog_path(folder, design)
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise DesignError(f"{path}: the Verilog of the build cannot be read: {reason}") from None


def verilog_path(folder: Path, design: Design) -> Path:
    """The Verilog of a build folder."""
    return folder / f"{design.name}.v"


@contextmanager
def blamed_on(path: Path) -> Iterator[None]:
    """The tools' complaints about the Verilog that they were given name the user's file."""
    try:
        yield
    except ToolError as error:
        line = re.sub(r"\bdesign\.v:(\d+)(\.\d+-\d+(\.\d+)?)?:?", r"line \1:", str(error))
        raise ToolError(f"{path}: {line}") from None


def planned_design(design: Design, progress: Progress = silent) -> tuple[Numbers | FloatNumbers, Plan]:
    """The numbers and the schedule of a design, without its Verilog.

    Raises DesignError, FormatError, ScheduleError.
    """
    progress("tracing the algorithm and choosing formats")
    typed = numbers_of(design)
    progress("scheduling")
    return typed, planned(design, typed)


def verify_long(
    hardware: Hardware,
    steps: int,
    plots: Plots | None = None,
    seed: int = 1,
    simulators: tuple[Simulator, ...] = (Simulator.CXXRTL,),
) -> tuple[Verification, ...]:
    """As ``pipeline.verify``, any number of steps, in runs that fit in memory.

    Raises VerificationError at the first bit that differs.
    """
    found: dict[tuple[str, str], Verification] = {}
    fast = worth_optimising(hardware, steps)
    for run_seed, run_steps in _runs(hardware, steps, seed):
        data = plots if run_seed == seed else None
        for one in verify(hardware, run_steps, data, run_seed, optimised=fast, simulators=simulators):
            which = one.simulator, one.stimulus
            found[which] = _joined(found[which], one) if which in found else one
    return tuple(
        found[which] for which in sorted(found, key=lambda which: simulators.index(Simulator(which[0])))
    )


def add_to_report(folder: Path, found: tuple[Verification, ...]) -> None:
    """Put verifications into the report of a build folder, in place of earlier ones by the same simulators.

    Raises DesignError where the folder's report cannot be read, OutputError where it cannot be written.
    """
    from kalmanhdl.report.writer import json_text

    path = folder / "report.json"
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
        again = {one.simulator for one in found}
        kept = [one for one in report["verification"] if one["simulator"] not in again]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DesignError(f"{path}: the report of the build cannot be read: build it again") from error
    report["verification"] = [*kept, *(asdict(one) for one in found)]
    with new_file(path, force=True) as file:
        file.write_text(json_text(report), encoding="utf-8")


def _runs(hardware: Hardware, steps: int, seed: int) -> Iterator[tuple[int, int]]:
    """The seed and the steps of every run; a run takes two seeds."""
    graph = hardware.numbers.typed.graph
    most = max(1000, _KEPT_NUMBERS // len(graph.roots))
    for run_seed in count(seed, 2):
        yield run_seed, min(steps, most)
        steps -= most
        if steps <= 0:
            return


def _joined(first: Verification, second: Verification) -> Verification:
    cycles = first.cycles + second.cycles
    rates = ((one.cycles, one.cycles_per_second) for one in (first, second))
    seconds = sum(cycles / rate for cycles, rate in rates if rate)
    return replace(
        first,
        steps=first.steps + second.steps,
        bits=first.bits + second.bits,
        cycles=cycles,
        cycles_per_second=cycles / seconds if seconds else 0.0,
    )


def _need_compiler() -> None:
    """Fail before the work, not after it."""
    from kalmanhdl.toolchain.compiler import find_compiler

    try:
        find_compiler()
    except ToolError as error:
        raise ToolError(f"{error}, or build without verification, --no-verify") from None
