"""A design whose control store is writable, the whole line down: image, Verilog, verification, figures."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

from kalmanhdl.design import Design
from kalmanhdl.numerics.integers import Numbers, numbers
from kalmanhdl.programmable.control import Layout
from kalmanhdl.programmable.image import Image, image_of
from kalmanhdl.programmable.text import image_csv, listing, ports_text
from kalmanhdl.programmable.verification import BETWEEN, Bound, border_of, verify_images
from kalmanhdl.programmable.verilog import verilog_of
from kalmanhdl.shape import Shape
from kalmanhdl.simulate.data import Plots
from kalmanhdl.toolchain.nextpnr import Implementation
from kalmanhdl.toolchain.simulators import Simulator, simulate_with
from kalmanhdl.validation import InvalidValueError
from kalmanhdl.verify.compare import Verification

Progress = Callable[[str], None]

# Clocks of a verification in a compiled simulator, and that Icarus takes so many times as long.
_USUAL_CLOCKS, _SLOWER = 400_000, 10
# Beyond so many, an optimised simulator repays its compilation.
_WORTH_OPTIMISING = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Programmed:
    """A design on programmable hardware: its numbers, its image, and the Verilog that begins with it."""

    design: Design
    numbers: Numbers
    image: Image
    verilog: str

    @property
    def interval(self) -> int:
        """Clocks between two steps."""
        return len(self.image.rows) + BETWEEN


def shape_of(design: Design) -> Shape:
    """The shape of a design's hardware. Raises DesignError where its control store is not writable."""
    if design.shape is None:
        raise InvalidValueError(
            "architecture", "control", ' = "fixed": nothing can be loaded: use "writable"'
        )
    return design.shape


def numbers_of(design: Design) -> Numbers:
    """The numbers of a design for multipliers. Raises FormatError, DesignError for floating point."""
    return numbers(design.model, design.algorithm, design.fixed_point, on_multipliers=True)


def bound(design: Design, shape: Shape, found: Numbers | None = None) -> Bound:
    """A design, whichever its own hardware is, as an image for a shape.

    Raises DesignError, FormatError, ScheduleError, where it does not fit the shape.
    """
    typed = (found or numbers_of(design)).typed
    return Bound(name=design.name, model=design.model, typed=typed, image=image_of(typed, shape))


def programmed(design: Design, progress: Progress) -> Programmed:
    """The hardware of a design, its own image in it. Raises as ``bound``, and ToolError."""
    progress("tracing the algorithm and choosing formats")
    found = numbers_of(design)
    progress("binding the step to the units")
    image = bound(design, shape_of(design), found).image
    progress("writing Verilog")
    return Programmed(design=design, numbers=found, image=image, verilog=verilog_of(design.name, image))


def usual_steps(hardware: Programmed, simulators: Sequence[Simulator]) -> int:
    """Steps that take a minute at most."""
    clocks = _USUAL_CLOCKS // (_SLOWER if Simulator.ICARUS in simulators else 1)
    return max(1, clocks // hardware.interval)


def verify(
    hardware: Programmed,
    steps: int,
    *,
    others: Sequence[Bound] = (),
    plots: Plots | None = None,
    seed: int = 1,
    simulators: Sequence[Simulator] = (Simulator.CXXRTL,),
    progress: Progress,
) -> tuple[Verification, ...]:
    """The Verilog against the engine: as it is configured, then with other images written, then its own.

    Raises VerificationError at the first bit that differs.
    """
    design, name = hardware.design, hardware.design.name
    own = Bound(
        name=name, model=design.model, typed=hardware.numbers.typed, image=hardware.image, plots=plots
    )
    images = (
        replace(own, name=f"{name}, configured", configured=True),
        *(replace(each, name=f"{each.name}, written") for each in others),
        replace(own, name=f"{name}, written"),
    )
    clocks = steps * sum(len(each.image.rows) for each in images)
    border, found = border_of(hardware.image.shape), list[Verification]()
    for simulator in simulators:
        progress(f"verifying {steps} steps of {len(images)} images in {simulator}")
        simulate = simulate_with(
            simulator, hardware.verilog, name, border, optimised=clocks > _WORTH_OPTIMISING
        )
        found += verify_images(simulate, name, images, steps, seed)
    return tuple(found)


def implement(hardware: Programmed, progress: Progress) -> tuple[Implementation, ...]:
    """Synthesis, then place and route with every seed, the fastest first. Raises ToolError."""
    from kalmanhdl.toolchain.absorb import absorb_registers
    from kalmanhdl.toolchain.nextpnr import best, place_and_route
    from kalmanhdl.toolchain.yosys import synthesise_ecp5

    target = hardware.design.target
    progress(f"synthesising for {target.part.name}")
    netlist = absorb_registers(synthesise_ecp5(hardware.verilog, hardware.design.name))
    progress(f"placing and routing, {target.seeds} seeds")
    wanted = 1000 / target.part.pipelined_period_ns
    found = place_and_route(netlist, target.part, range(1, target.seeds + 1), wanted)
    first = best(found)
    return (first, *(one for one in found if one is not first))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Built:
    """What a build made, and the seconds that it took."""

    hardware: Programmed
    verifications: tuple[Verification, ...] = ()
    placed: tuple[Implementation, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)


def build(
    design: Design,
    *,
    steps: int | None,
    plots: Plots | None,
    place: bool,
    simulators: Sequence[Simulator],
    progress: Progress,
) -> Built:
    """Everything of a design. ``steps``: None for the usual number, 0 for no verification."""
    seconds: dict[str, float] = {}
    begin = time.perf_counter()
    hardware = programmed(design, progress)
    seconds["rtl"] = time.perf_counter() - begin
    found: tuple[Verification, ...] = ()
    count = usual_steps(hardware, simulators) if steps is None else steps
    if count:
        begin = time.perf_counter()
        found = verify(hardware, count, plots=plots, simulators=simulators, progress=progress)
        seconds["verify"] = time.perf_counter() - begin
    placed: tuple[Implementation, ...] = ()
    if place:
        begin = time.perf_counter()
        placed = implement(hardware, progress)
        seconds["place_and_route"] = time.perf_counter() - begin
    return Built(hardware=hardware, verifications=found, placed=placed, seconds=seconds)


def contents(hardware: Programmed) -> dict[str, str]:
    """The files of a build, but for its design and its report."""
    from kalmanhdl.graph.text import print_graph

    return {
        f"{hardware.design.name}.v": hardware.verilog,
        "image.csv": image_csv(hardware.image),
        "ports.txt": ports_text(hardware.numbers.typed, hardware.image.shape),
        "graph.txt": print_graph(hardware.numbers.graph),
        "schedule.txt": listing(hardware.image.schedule),
    }


def figures(built: Built) -> dict[str, object]:
    """The report of a build as plain values."""
    hardware = built.hardware
    design, image = hardware.design, hardware.image
    shape = image.shape
    one = built.placed[0] if built.placed else None
    return {
        "design": design.name,
        "schema": 1,
        "architecture": "programmable",
        "algorithm": design.algorithm.kind,
        "shape": {**asdict(shape), "units": dict(shape.units)},
        "image": {
            "rows": len(image.rows),
            "row_bits": Layout(shape).row_bits,
            "words": dict(image.words_used),
            "loads": len(image.words),
            "clocks_per_step": hardware.interval,
        },
        "verification": [asdict(each) for each in built.verifications],
        "implementation": None
        if one is None
        else {
            "device": one.device,
            "grade": one.grade,
            "tool": one.tool,
            "fmax_mhz": one.fmax_mhz,
            "luts": one.luts,
            "ffs": one.ffs,
            "multipliers": one.multipliers,
            "block_rams": one.block_rams,
            "updates_per_second": one.fmax_mhz * 1e6 / hardware.interval,
        },
        "seconds": dict(built.seconds),
    }


def summary(image: Image) -> list[tuple[str, str]]:
    """Rows of a table: the shape, and how much of it a filter takes."""
    shape, layout = image.shape, Layout(image.shape)
    units = ", ".join(f"{count} {kind}" for kind, count in shape.units.items())
    used = sorted({unit: image.schedule.units.count(unit) for unit in shape.unit_names}.items())
    fullest = max(image.words_used, key=lambda file: image.words_used[file])
    return [
        ("units", units),
        ("words", f"{shape.word_width} bits, operands of multipliers {shape.operand_width}"),
        ("control", f"{len(image.rows)} of {shape.rows} rows of {layout.row_bits} bits"),
        ("files", f"{image.words_used[fullest]} of {shape.words} words in {fullest}, the fullest of all"),
        ("operations", ", ".join(f"{count} on {unit}" for unit, count in used)),
        ("a step", f"{len(image.rows) + BETWEEN} clocks"),
        ("image", f"{len(image.words)} words to write"),
    ]


def implementation_rows(hardware: Programmed, placed: Sequence[Implementation]) -> list[tuple[str, str]]:
    """Rows of a table: what the hardware takes of a device, and how fast it is."""
    return [
        (
            f"{one.device}-{one.grade}, seed {one.seed}",
            f"{one.fmax_mhz:.1f} MHz, {one.luts} LUTs, {one.ffs} registers, {one.multipliers} multiplier "
            f"blocks, {one.block_rams} block RAMs; {one.fmax_mhz / hardware.interval:.3f} M updates/s",
        )
        for one in placed
    ]
