"""When lanes that share their streams take steps and hand over results, to the clock.

A step passes places in a row: the entrance of all, the entrance of its lane, the places where steps wait for
their track, the datapath, the lane's queue, the exit of all. It moves on when the place is free and the steps
before it have gone. Each clock below is that in which a step leaves a place for the next.
"""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from kalmanhdl.schedule.plan import Plan
from kalmanhdl.verify.timing import (
    EXIT,
    READY,
    RETURN,
    START,
    Cycles,
    next_slot,
    queue_places,
    results,
    return_clocks,
    waits,
)

# A clock that never comes.
NEVER = 1 << 40


@dataclass(slots=True)
class _Lane:
    """The clocks of the steps of a lane: into the places where they wait, started, out of the queue."""

    entered: list[int] = field(default_factory=list)
    second: list[int] = field(default_factory=list)
    started: list[int] = field(default_factory=list)
    fetched: list[int] = field(default_factory=list)
    taken: list[int] = field(default_factory=list)

    def moves_on(self, clock: int) -> int:
        """The first clock from one on in which the waiting steps move: none stands before its start."""
        for arrived, started in zip(self.second[-2:], self.started[-2:], strict=True):
            if arrived < clock < started:
                clock = started
        return clock


def shared_flow(plan: Plan, lanes: int, tracks: Cycles, first_taken: int = 0) -> tuple[Cycles, Cycles]:
    """The clocks after reset in which steps are taken and handed over, where steps are always offered.

    ``tracks`` numbers the track of each step; track t is one of lane t mod ``lanes``. Results are always
    taken from the clock ``first_taken`` on.
    """
    inside = [_Lane() for _ in range(lanes)]
    last: dict[int, int] = defaultdict(lambda: -NEVER)
    accepted, handed_on, collected, given = ([-NEVER, -NEVER] for _ in range(4))
    for track in tracks.tolist():
        lane = inside[track % lanes]
        accepted.append(max(READY, accepted[-1] + 1, handed_on[-2] + 1))
        handed_on.append(max(accepted[-1], handed_on[-1], _nth_last(lane.entered, 2)) + 1)
        last[track] = _start(plan, lane, handed_on[-1] + 1, last[track])
        written = last[track] + START + results(plan)
        lane.fetched.append(max(written + EXIT - 1, _nth_last(lane.taken, 1)))
        collected.append(max(lane.fetched[-1], collected[-1], given[-2]) + 1)
        lane.taken.append(collected[-1])
        given.append(max(collected[-1] + 1, given[-1] + 1, first_taken))
    return np.array(accepted[2:]), np.array(given[2:])


def _start(plan: Plan, lane: _Lane, offered: int, before: int) -> int:
    """The clock in which a step starts, which a lane may take from ``offered`` on."""
    entered = offered
    if waits(plan):
        entered = lane.moves_on(max(offered, _nth_last(lane.entered, 1) + 1))
        lane.second.append(lane.moves_on(entered + 1))
        offered = lane.second[-1] + 1
    room = _nth_last(lane.fetched, queue_places(plan)) + RETURN
    follows = _nth_last(lane.started, 1) + plan.interval
    started = next_slot(plan, max(offered, follows, room, before + return_clocks(plan)))
    lane.started.append(started)
    lane.entered.append(entered if waits(plan) else started)
    return started


def _nth_last(clocks: list[int], n: int) -> int:
    return clocks[-n] if len(clocks) >= n else -NEVER
