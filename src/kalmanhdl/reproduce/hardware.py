"""Hardware side by side: what a paper prints, its architecture as built here, and the best for the task."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from kalmanhdl.design import Design
from kalmanhdl.pipeline import Hardware, Progress, compile_design, implement, silent, verify
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.toolchain.nextpnr import Implementation

COLUMNS = (
    "architecture",
    "clocks a step",
    "MHz",
    "ns a step",
    "M steps/s",
    "multipliers",
    "LUTs",
    "registers",
    "block RAMs",
)
STEPS = 2_000
"""Steps of each design's Verilog that are held against the engine before it is placed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quoted:
    """A paper's own figures, as text by column; what it does not print is not there."""

    name: str
    figures: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """An architecture to build."""

    name: str
    design: Design


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Built:
    """An architecture that was verified, placed and routed; the bits that were compared."""

    name: str
    interval: int
    channels: int
    placed: Implementation
    bits: int

    @property
    def nanoseconds(self) -> float:
        """From one step to the next."""
        return 1000 * self.interval / self.placed.fmax_mhz

    @property
    def seed(self) -> int:
        """The placement seed that gave the figures."""
        return self.placed.seed


Entry = Quoted | Built


def built(candidates: Iterable[Candidate], progress: Progress = silent) -> tuple[Built, ...]:
    """Each candidate compiled, verified, placed and routed with the seeds of its design.

    Raises as ``pipeline.compile_design``, ``verify`` and ``implement`` do.
    """
    return tuple(_built(candidate, progress) for candidate in candidates)


def _built(candidate: Candidate, progress: Progress) -> Built:
    def told(message: str) -> None:
        progress(f"{candidate.name}: {message}")

    hardware: Hardware = compile_design(candidate.design, told)
    runs = verify(hardware, STEPS, progress=told)
    return Built(
        name=candidate.name,
        interval=hardware.plan.interval,
        channels=hardware.plan.channels,
        placed=implement(hardware, told).best,
        bits=sum(run.bits for run in runs),
    )


def table(title: str, entries: Iterable[Entry], notes: tuple[str, ...]) -> Reproduction:
    """The architectures as rows, in their order."""
    told = tuple(entries)
    made = [entry for entry in told if isinstance(entry, Built)]
    devices = sorted({f"{one.placed.device} grade {one.placed.grade}" for one in made})
    bits = sum(one.bits for one in made)
    return Reproduction(
        title=title,
        columns=COLUMNS,
        rows=tuple(_row(entry) for entry in told),
        notes=(
            f"Rows without a year are kalmanhdl's, on {' and '.join(devices)}, placed and routed by "
            f"nextpnr, the best of the seeds tried; of their Verilog {bits} bits were held against "
            "the engine, none differed. Rows with a year are quoted: devices of their time and other tools, "
            "so that clocks and operators compare, nanoseconds less.",
            *notes,
        ),
        charts={},
    )


def _row(entry: Entry) -> tuple[str, ...]:
    if isinstance(entry, Quoted):
        return entry.name, *(entry.figures.get(column, "") for column in COLUMNS[1:])
    placed = entry.placed
    tracks = f", {entry.channels} tracks in turn" if entry.channels > 1 else ""
    return (
        f"{entry.name}{tracks} (seed {entry.seed})",
        str(entry.interval),
        f"{placed.fmax_mhz:.1f}",
        f"{entry.nanoseconds:.1f}",
        f"{placed.fmax_mhz / entry.interval:.2f}",
        str(placed.multipliers),
        str(placed.luts),
        str(placed.ffs),
        str(placed.block_rams),
    )
