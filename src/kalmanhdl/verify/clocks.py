"""What a design's streams promise to the clock, whichever way they lead to its filters."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from kalmanhdl.rtl.interface import Interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.verify import timing
from kalmanhdl.verify.sharing import NEVER, shared_flow
from kalmanhdl.verify.timing import Cycles


class Clocks(Protocol):
    """The clocks after reset of one pair of streams that never pause. Of shared streams the tracks are those
    of all lanes."""

    @property
    def held_back(self) -> int:
        """How many steps are taken while no result is."""

    @property
    def never_waits(self) -> bool:
        """Whether no step waits for the one of its track before it, when tracks come in turn."""

    @property
    def in_full_flow(self) -> int:
        """How many results are on the way when tracks come in turn."""

    def on_the_way(self, *, steady: bool) -> int:
        """How many results may be on the way while the entrance surely takes another step."""

    def handed_over(self, tracks: Cycles) -> Cycles:
        """The clock of each result of steps that are always offered and always taken."""

    def accepted_again(self, clock: int) -> int:
        """The clock in which full hardware takes the next step, its first result being taken in ``clock``."""


def clocks_of(plan: Plan, shown: Interface) -> Clocks:
    """The clocks of a design."""
    return _Shared(plan=plan, lanes=shown.lanes) if shown.lane_width else _Own(plan=plan)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Own:
    """A filter with streams of its own."""

    plan: Plan

    @property
    def held_back(self) -> int:
        return timing.held_back(self.plan)

    @property
    def never_waits(self) -> bool:
        return timing.never_waits(self.plan)

    @property
    def in_full_flow(self) -> int:
        return timing.in_full_flow(self.plan)

    def on_the_way(self, *, steady: bool) -> int:
        return timing.on_the_way(self.plan, steady=steady)

    def handed_over(self, tracks: Cycles) -> Cycles:
        return timing.handed_over(self.plan, tracks)

    def accepted_again(self, clock: int) -> int:
        return timing.accepted_again(self.plan, clock)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shared:
    """Lanes that share a pair of streams."""

    plan: Plan
    lanes: int

    @property
    def held_back(self) -> int:
        most = self.lanes * (timing.held_back(self.plan) + 1) + 4
        accepted, _ = shared_flow(self.plan, self.lanes, self._in_turn(most), NEVER)
        return int((accepted < NEVER).sum())

    @property
    def never_waits(self) -> bool:
        return timing.never_waits(self.plan)

    @property
    def in_full_flow(self) -> int:
        return timing.in_full_flow(self.plan) * min(self.lanes, self.plan.interval)

    def on_the_way(self, *, steady: bool) -> int:
        # All steps may be of one lane.
        return timing.on_the_way(self.plan, steady=steady)

    def handed_over(self, tracks: Cycles) -> Cycles:
        return shared_flow(self.plan, self.lanes, tracks)[1]

    def accepted_again(self, clock: int) -> int:
        held = self.held_back
        accepted, _ = shared_flow(self.plan, self.lanes, self._in_turn(held + 1), clock)
        return int(accepted[held])

    def _in_turn(self, count: int) -> Cycles:
        return np.arange(count) % (self.lanes * self.plan.channels)
