"""Everything that a build produced, as one value: what the report reports on."""

from dataclasses import dataclass, field

from kalmanhdl.closure.rounds import Closure
from kalmanhdl.pipeline import Hardware, Implemented
from kalmanhdl.proof.prove import Proof
from kalmanhdl.schedule.summary import Summary, summarise
from kalmanhdl.simulate.side_by_side import Simulation
from kalmanhdl.toolchain.area import AreaFigures
from kalmanhdl.verify.compare import Verification


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record:
    """A build down to where it went: a stage that did not run is None, or empty.

    ``seconds`` are those of stages that keep none of their own: ``simulate``, ``prove``, ``verify``,
    ``areas``.
    """

    hardware: Hardware
    simulation: Simulation | None = None
    verifications: tuple[Verification, ...] = ()
    implemented: Implemented | None = None
    closure: Closure | None = None
    areas: tuple[AreaFigures, ...] = ()
    proof: Proof | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def summary(self) -> Summary:
        """The schedule in numbers."""
        return summarise(self.hardware.plan, self.hardware.design.target.part)

    @property
    def all_seconds(self) -> dict[str, float]:
        """The seconds of every stage that ran."""
        placed = self.implemented.seconds if self.implemented else {}
        return {**self.hardware.seconds, **placed, **self.seconds}
