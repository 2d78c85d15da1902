"""The whole line: each stage is a function from the values before it to its own."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.design import MAX_INTERVAL, Architecture, Coefficients, Design
from kalmanhdl.errors import ScheduleError
from kalmanhdl.numerics.floating import FloatGraph, FloatNumbers, FloatSpecification, float_numbers
from kalmanhdl.numerics.integers import Numbers, numbers
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.proof.prove import Proof, prove
from kalmanhdl.rtl.interface import Interface, interface
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.wanted import Wanted
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.side_by_side import Simulation
from kalmanhdl.simulate.side_by_side import simulate as run_side_by_side
from kalmanhdl.target import Device
from kalmanhdl.toolchain.area import AreaFigures
from kalmanhdl.toolchain.nextpnr import Implementation
from kalmanhdl.toolchain.simulators import Simulator, simulate_with
from kalmanhdl.toolchain.stages import timed
from kalmanhdl.toolchain.yosys import Netlist
from kalmanhdl.validation import InvalidValueError, KalmanhdlWarning
from kalmanhdl.verify.compare import Verification

Progress = Callable[[str], None]

# The papers' families, for synthesis figures beside theirs.
AREA_FAMILIES = ("xc4v", "xc5v", "xc6v", "lut4")


# Beside so many steps, a search for the covariance's corners costs little.
WALKING_STEPS = 20_000
# Clocks. Both costs grow with the hardware, so that the size of it does not matter.
_WORTH_OPTIMISING = 80_000
# Clocks, and steps; Icarus interprets.
_USUAL_CLOCKS, _MOST_USUAL, _SLOWER = 2_000_000, 500_000, 20


def silent(_: str) -> None:
    """Progress that nobody follows."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hardware:
    """A design down to its Verilog, and the seconds that its stages took."""

    design: Design
    numbers: Numbers | FloatNumbers
    plan: Plan
    interface: Interface
    verilog: str
    seconds: dict[str, float] = field(default_factory=dict)


def compile_design(design: Design, progress: Progress = silent) -> Hardware:
    """Model, algorithm, graph, numerics, schedule, RTL.

    Raises:
        DesignError, FormatError, ScheduleError, ToolError: see the stages.
    """
    seconds: dict[str, float] = {}
    with timed(seconds, "trace", progress, "tracing the algorithm and choosing formats"):
        typed = numbers_of(design)
    with timed(seconds, "schedule", progress, "scheduling"):
        plan = planned(design, typed)
    return realised(design, typed, plan, progress, seconds)


def realised(
    design: Design,
    typed: Numbers | FloatNumbers,
    plan: Plan,
    progress: Progress = silent,
    seconds: dict[str, float] | None = None,
) -> Hardware:
    """The hardware of a schedule; ``seconds`` are those of the stages before. Raises ToolError."""
    seconds = {} if seconds is None else seconds
    with timed(seconds, "rtl", progress, "writing Verilog"):
        verilog = verilog_of(design, plan)
    return Hardware(
        design=design,
        numbers=typed,
        plan=plan,
        interface=interface_of(design, plan),
        verilog=verilog,
        seconds=seconds,
    )


def proof_of(design: Design, typed: Numbers | FloatNumbers) -> Proof:
    """Which values never leave their formats. Raises DesignError for floating point, ToolError."""
    specification, graph = design.fixed_point, typed.typed
    assert isinstance(graph, TypedGraph)
    return prove(design.model, graph, specification.coast)


def planned(design: Design, typed: Numbers | FloatNumbers) -> Plan:
    """The schedule of a design, checked by code that does not share a line with the scheduler.

    Raises DesignError for what floating-point hardware has not, and for a filter that is an image,
    ScheduleError.
    """
    if design.shape is not None:
        problem = (
            ' = "writable": only build, show, verify, implement, image and what needs no hardware know it: '
            'use "fixed" for all else'
        )
        raise InvalidValueError("architecture", "control", problem)
    graph, asked = typed.typed, design.architecture
    if isinstance(graph, FloatGraph):
        _refuse_fixed_only(asked)
        graph = replace(graph, clocks=tuple((asked.clocks or {}).items()))
    else:
        _refuse_float_only(asked)
        graph = replace(graph, logic_product=asked.multiplier)
    part = design.target.part
    plan = schedule(graph, part, wanted(asked, part))
    found = problems(plan, part)
    if found:
        raise ScheduleError(f"{design.name}: the schedule is wrong: {found[0]}")
    return plan


def wanted(architecture: Architecture, part: Device) -> Wanted:
    """What a design asks the scheduler for. Raises DesignError for more updates than the clock has cycles."""
    interval, rate = architecture.interval, architecture.updates_per_second
    if rate is not None:
        clock_mhz = architecture.clock_mhz or 1000 / part.pipelined_period_ns
        interval = int(clock_mhz * 1e6 * architecture.lanes / rate)
        most = clock_mhz * architecture.lanes_fed(1)
        if interval < 1 or rate > most * 1e6:
            problem = f" = {rate:g}: a clock of {clock_mhz:.1f} MHz starts {most:.1f} million at most"
            raise InvalidValueError("architecture", "updates_per_second", problem)
        if interval > MAX_INTERVAL:
            least = clock_mhz * 1e6 * architecture.lanes / MAX_INTERVAL
            problem = (
                f" = {rate:g}: an interval of {interval} clocks follows at {clock_mhz:.1f} MHz, and "
                f"{MAX_INTERVAL} are the most: ask for {least:.6g} or more, or for a lower clock_mhz"
            )
            raise InvalidValueError("architecture", "updates_per_second", problem)
    return Wanted(
        interval=interval,
        channels=architecture.channels,
        clock_mhz=architecture.clock_mhz,
        multiplier_blocks=architecture.multiplier_blocks,
        units=architecture.units,
        latency=architecture.latency,
        iterative=architecture.iterative,
        solver_seconds=architecture.solver_seconds,
    )


def _refuse_fixed_only(wanted: Architecture) -> None:
    if wanted.multiplier is LogicProduct.WALLACE:
        problem = ' = "wallace": floating-point products are made of Booth rows: use "booth"'
        raise InvalidValueError("architecture", "multiplier", problem)
    if "multiply_add" in (wanted.units or {}):
        problem = ": floating-point sums round after every product: count multiply and add"
        raise InvalidValueError("architecture", "units.multiply_add", problem)


def _refuse_float_only(wanted: Architecture) -> None:
    if wanted.clocks is not None:
        problem = ' are for [numerics] kind = "float": in fixed point write clock_mhz'
        raise InvalidValueError("architecture", "clocks", problem)


def verilog_of(design: Design, plan: Plan) -> str:
    """The Verilog of a plan, as the user gets it."""
    # Amaranth takes a third of a second to import; who only simulates does not need it.
    from kalmanhdl.rtl.filter import Filter
    from kalmanhdl.rtl.lanes import Lanes
    from kalmanhdl.rtl.verilog import header, to_rtlil
    from kalmanhdl.toolchain.yosys import rtlil_to_verilog

    wanted, name, module = design.architecture, design.name, lane_module(design)
    if module is None:
        rtlil = to_rtlil(Filter(plan), name)
    else:
        rtlil = to_rtlil(Filter(plan), module)
        rtlil += to_rtlil(Lanes(plan, wanted.lanes, wanted.streams, module), name)
    return rtlil_to_verilog(rtlil, name, header(plan, name, wanted.lanes, wanted.streams))


def lane_module(design: Design) -> str | None:
    """The Verilog module of which every lane is an instance; None where there is but one."""
    return f"{design.name}_lane" if design.architecture.lanes > 1 else None


def interface_of(design: Design, plan: Plan) -> Interface:
    """The ports of a design's hardware."""
    return interface(plan, design.architecture.lanes, design.architecture.streams)


def numbers_of(design: Design) -> Numbers | FloatNumbers:
    """The numbers of a design, fixed or floating point.

    Raises FormatError, and DesignError for a design whose filter is a program of the processor.
    """
    if design.processor is not None:
        problem = (
            ' = "processor": the filter is a program, and has no hardware of its own: use "datapath" for this'
        )
        raise InvalidValueError("architecture", "kind", problem)
    loadable = design.architecture.coefficients is Coefficients.LOADABLE
    if isinstance(design.numerics, FloatSpecification):
        if loadable:
            problem = ' = "loadable" is for fixed point: use "fixed"'
            raise InvalidValueError("architecture", "coefficients", problem)
        return float_numbers(design.model, design.algorithm, design.numerics)
    return fixed_numbers(design)


def fixed_numbers(design: Design) -> Numbers:
    """The fixed-point numbers of a design. Raises FormatError, and DesignError for floating point."""
    asked = design.architecture
    return numbers(
        design.model,
        design.algorithm,
        design.fixed_point,
        on_multipliers=design.shares_multipliers,
        loadable=asked.coefficients is Coefficients.LOADABLE,
    )


def simulate(design: Design, plots: Plots, typed: Numbers | FloatNumbers | None = None) -> Simulation:
    """Float reference and bit-exact engine side by side on data.

    Warns with KalmanhdlWarning where measurements are missed that the algorithm makes up for approximately.
    """
    missed = int(np.isnan(plots.z[plots.active]).sum())
    if missed and design.algorithm.when_missed:
        warnings.warn(
            f"{missed} of {plots.z.shape[2] * int(plots.active.sum())} measurements are missed: [algorithm] "
            f'kind = "{design.algorithm.kind}" {design.algorithm.when_missed}: choose another where they are '
            "many",
            KalmanhdlWarning,
            stacklevel=2,
        )
    return run_side_by_side(design.model, design.algorithm(design.model), typed or numbers_of(design), plots)


def usual_steps(hardware: Hardware, simulators: tuple[Simulator, ...] = (Simulator.CXXRTL,)) -> int:
    """Steps that find what is wrong in the last bits of a rounding too, where they take a minute at most."""
    clocks = _USUAL_CLOCKS // (_SLOWER if Simulator.ICARUS in simulators else 1)
    return min(max(clocks // hardware.plan.interval, WALKING_STEPS), _MOST_USUAL)


def worth_optimising(hardware: Hardware, steps: int) -> bool:
    """Whether so many steps repay an optimised simulator, whose compilation takes seconds or minutes."""
    return steps * hardware.plan.interval > _WORTH_OPTIMISING


def verify(
    hardware: Hardware,
    steps: int,
    plots: Plots | None = None,
    seed: int = 1,
    progress: Progress = silent,
    optimised: bool | None = None,
    simulators: tuple[Simulator, ...] = (Simulator.CXXRTL,),
) -> tuple[Verification, ...]:
    """The Verilog against the engine: on data, on tracks drawn from the model, on raw numbers at random.

    ``steps`` are split between the latter two; the last also stalls both streams, fills the hardware up and
    resets it in the middle. Beside many steps there are some more, that take the covariance into its corners.
    Every one of ``simulators`` runs the same steps; it is ``optimised`` where their number is worth its
    compilation.
    Raises VerificationError at the first bit that differs, or that comes in another clock than it should.
    """
    from kalmanhdl.simulate.engine import Engine
    from kalmanhdl.verify.border import border_of
    from kalmanhdl.verify.compare import verify as run
    from kalmanhdl.verify.stimulus import Section, from_model, from_plots, random_sections, walking
    from kalmanhdl.verify.walk import walks

    model, plan, typed, shown = (
        hardware.design.model,
        hardware.plan,
        hardware.numbers.typed,
        hardware.interface,
    )
    half, tracks = max(1, steps // 2), plan.channels * shown.lanes
    progress(f"verifying {steps} steps, Verilog against engine")
    runs = [
        ("model", (Section(steps=from_model(model, typed, half, tracks, seed)),)),
        ("random", random_sections(plan, shown, half, seed + 1)),
    ]
    # What drives integers to their limits is searched for; a number in floating point has none so near.
    if steps >= WALKING_STEPS and isinstance(typed, TypedGraph) and (found := walks(typed, seed)):
        ways = (walking(typed, found, tracks, seed, calm=calm) for calm in (True, False))
        runs.append(("walks", tuple(Section(steps=steps) for steps in ways)))
    if plots is not None:
        runs.insert(0, ("data", (Section(steps=from_plots(model, typed, plots, tracks)),)))
    fast = worth_optimising(hardware, steps) if optimised is None else optimised
    name = hardware.design.name
    # An engine that is made quickly keeps up with any simulator: it has no clocks between its steps.
    engine = Engine.of(typed, optimised=fast)
    verified = []
    for each in simulators:
        simulate = simulate_with(each, hardware.verilog, name, border_of(shown), optimised=fast)
        for kind, sections in runs:
            verified.append(run(simulate, name, plan, shown, engine, sections, stimulus=kind))
    return tuple(verified)


def bench_files(hardware: Hardware, *, optimised: bool) -> Mapping[str, str]:
    """The test bench that a build ships, file by file; ``optimised`` says which engine makes its vectors."""
    from kalmanhdl.simulate.engine import Engine
    from kalmanhdl.testbench.folder import contents

    design = hardware.design
    engine = Engine.of(hardware.numbers.typed, optimised=optimised)
    return contents(design.name, design.model, hardware.plan, hardware.interface, engine)


@dataclass(frozen=True, slots=True, kw_only=True)
class Implemented:
    """Every placement that was tried, the best first, and the clock that was asked for."""

    placements: tuple[Implementation, ...]
    seconds: dict[str, float]

    @property
    def best(self) -> Implementation:
        """The fastest placement."""
        return self.placements[0]


# Of a clock; the rest is for wires.
_LOGIC_SHARE = 0.6


def synthesise(hardware: Hardware) -> Netlist:
    """The netlist for the design's device. Raises ToolError."""
    from kalmanhdl.toolchain.absorb import absorb_registers
    from kalmanhdl.toolchain.yosys import synthesise_ecp5

    design, plan = hardware.design, hardware.plan
    # Among many choices of operands few are urgent: left to itself, logic is a fifth larger for nothing.
    logic_ns = _LOGIC_SHARE * plan.period_ns if "multiply_add" in plan.sharing.counts else None
    return absorb_registers(synthesise_ecp5(hardware.verilog, design.name, lane_module(design), logic_ns))


def implement(hardware: Hardware, progress: Progress = silent) -> Implemented:
    """Synthesis, then place and route with every seed. Raises ToolError."""
    from kalmanhdl.toolchain.nextpnr import best, place_and_route

    design, seconds = hardware.design, dict[str, float]()
    part = design.target.part
    with timed(seconds, "synthesise", progress, f"synthesising for {part.name}"):
        netlist = synthesise(hardware)
    wanted = design.architecture.clock_mhz or 1000 / hardware.plan.period_ns
    seeds = range(1, design.target.seeds + 1)
    with timed(seconds, "place_and_route", progress, f"placing and routing, {len(seeds)} seeds"):
        placed = place_and_route(netlist, part, seeds, wanted)
    first = best(placed)
    rest = tuple(one for one in placed if one is not first)
    return Implemented(placements=(first, *rest), seconds=seconds)


def areas(hardware: Hardware, progress: Progress = silent) -> tuple[AreaFigures, ...]:
    """Synthesis figures on the papers' families."""
    from kalmanhdl.toolchain.area import area

    progress("synthesising for the papers' families")
    return tuple(area(hardware.verilog, hardware.design.name, family) for family in AREA_FAMILIES)
