"""Hardware side by side: what a paper prints, its architecture as built here, and the best for the task."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, assert_never

from kalmanhdl.design import Design
from kalmanhdl.pipeline import Hardware, Progress, compile_design, implement, silent, synthesise, verify
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.toolchain.nextpnr import Implementation

COLUMNS = (
    "architecture",
    "operators that are shared",
    "clocks a step",
    "to its result",
    "MHz",
    "ns a step",
    "to its result, ns",
    "M steps/s",
    "multipliers",
    "LUTs",
    "registers",
    "block RAMs",
)
STEPS = 2_000
_ESTIMATES = (
    "An estimate is verified and synthesised, but not placed: it has the clock that its schedule expects, "
    "which wires can halve where many operators share, and look-up tables before packing."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quoted:
    """A paper's own figures, as text by column; what it does not print is not there."""

    name: str
    figures: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Software:
    """A program that did the task in this run, and the seconds of a step."""

    name: str
    seconds_per_step: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """An architecture to build, and the steps of its Verilog that are held against the engine before.

    Without ``place`` it is only synthesised: place and route would take hours, or never end.
    """

    name: str
    design: Design
    steps: int = STEPS
    place: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Built:
    """An architecture that was verified, placed and routed; the bits that were compared."""

    name: str
    plan: Plan
    bits: int
    placed: Implementation

    @property
    def origin(self) -> str:
        """How the figures came: the placement seed."""
        return f"seed {self.placed.seed}"

    @property
    def mhz(self) -> float:
        """The clock."""
        return self.placed.fmax_mhz

    @property
    def cells(self) -> tuple[int, int, int, int]:
        """Multipliers, look-up tables, registers, block RAMs."""
        placed = self.placed
        return placed.multipliers, placed.luts, placed.ffs, placed.block_rams


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimated:
    """An architecture that was verified and synthesised, but not placed: its clock is the schedule's."""

    name: str
    plan: Plan
    bits: int
    cells: tuple[int, int, int, int]
    origin: ClassVar[str] = "estimate, not placed"

    @property
    def mhz(self) -> float:
        """The clock that the schedule expects."""
        return 1000 / self.plan.period_ns


Ours = Built | Estimated
Entry = Quoted | Software | Ours


def built(candidates: Iterable[Candidate], progress: Progress = silent) -> tuple[Ours, ...]:
    """Each candidate compiled, verified, and placed and routed with the seeds of its design, or synthesised.

    Raises as ``pipeline.compile_design``, ``verify`` and ``implement`` do.
    """
    return tuple(_built(candidate, progress) for candidate in candidates)


def _built(candidate: Candidate, progress: Progress) -> Ours:
    def told(message: str) -> None:
        progress(f"{candidate.name}: {message}")

    hardware: Hardware = compile_design(candidate.design, told)
    runs = verify(hardware, candidate.steps, progress=told)
    plan, bits = hardware.plan, sum(run.bits for run in runs)
    if candidate.place:
        placed = implement(hardware, told).best
        return Built(name=candidate.name, plan=plan, bits=bits, placed=placed)
    told("synthesising")
    found = synthesise(hardware).cells
    cells = found["MULT18X18D"], found["LUT4"], found["TRELLIS_FF"], found.get("DP16KD", 0)
    return Estimated(name=candidate.name, plan=plan, bits=bits, cells=cells)


def table(title: str, entries: Iterable[Entry], notes: tuple[str, ...]) -> Reproduction:
    """The architectures as rows, in their order."""
    told = tuple(entries)
    made = [entry for entry in told if isinstance(entry, Ours)]
    bits = sum(one.bits for one in made)
    return Reproduction(
        title=title,
        columns=COLUMNS,
        rows=tuple(_row(entry) for entry in told),
        notes=(
            f"Rows without a year are of this run, kalmanhdl's on {_devices(made)}, placed and routed by "
            f"nextpnr, the best of the seeds tried; of their Verilog {bits} bits were held against "
            "the engine, none differed. Rows with a year are quoted: devices of their time and other tools, "
            "so that clocks and operators compare, nanoseconds less.",
            *((_ESTIMATES,) if any(isinstance(one, Estimated) for one in made) else ()),
            *notes,
        ),
        charts={},
    )


def _devices(made: Iterable[Ours]) -> str:
    placed = (one.placed for one in made if isinstance(one, Built))
    return " and ".join(sorted({f"{one.device} grade {one.grade}" for one in placed})) or "ecp5"


def counted(operators: Mapping[str, int]) -> str:
    """How many operators of each kind, in words."""
    return ", ".join(f"{count} {kind}" for kind, count in sorted(operators.items()))


def _row(entry: Entry) -> tuple[str, ...]:
    match entry:
        case Quoted():
            name, figures = entry.name, entry.figures
        case Software():
            name, figures = entry.name, _software(entry)
        case Built() | Estimated():
            channels = entry.plan.channels
            tracks = f", {channels} tracks in turn" if channels > 1 else ""
            name, figures = f"{entry.name}{tracks} ({entry.origin})", _measured(entry)
        case _:
            assert_never(entry)
    return name, *(figures.get(column, "") for column in COLUMNS[1:])


def _software(entry: Software) -> dict[str, str]:
    seconds = entry.seconds_per_step
    return {"ns a step": f"{1e9 * seconds:.0f}", "M steps/s": f"{1e-6 / seconds:.3g}"}


def _measured(entry: Ours) -> dict[str, str]:
    plan, (multipliers, luts, registers, block_rams) = entry.plan, entry.cells
    return {
        "operators that are shared": counted(plan.sharing.counts),
        "clocks a step": str(plan.interval),
        "to its result": str(plan.latency),
        "MHz": f"{entry.mhz:.1f}",
        "ns a step": f"{1000 * plan.interval / entry.mhz:.1f}",
        "to its result, ns": f"{1000 * plan.latency / entry.mhz:.1f}",
        "M steps/s": f"{entry.mhz / plan.interval:.3g}",
        "multipliers": str(multipliers),
        "LUTs": str(luts),
        "registers": str(registers),
        "block RAMs": str(block_rams),
    }
