"""When the hardware takes steps and hands over results, as docs/hardware.md promises it."""

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.schedule.plan import Plan

Cycles = NDArray[np.int64]

# The first clock after reset in which a step is taken.
READY = 1
# The register at the entrance, the two places where steps wait for their track, the register in which a step
# starts, and the queue at the exit, in clocks.
_ENTRANCE, _WAITING, START, EXIT = 1, 2, 1, 2
# Steps that the register at the entrance holds, and the result that stands at the exit.
_HELD, _OFFERED = 2, 1
# Clocks from a result being taken until its place is given out again.
RETURN = 2
# Clocks from a result being there until its place in the queue can be given out again, at the full rate.
_QUEUE = 3


def handed_over(plan: Plan, tracks: Cycles) -> Cycles:
    """The clock after reset of each result of steps that are always offered and always taken.

    ``tracks`` names the track of each step. A step starts as soon as interval and distance let it.
    """
    issued = np.empty(len(tracks), np.int64)
    slots = return_clocks(plan)
    last: dict[int, int] = {}
    earliest = next_slot(plan, READY + _ENTRANCE + _waiting(plan))
    for step, track in enumerate(tracks.tolist()):
        issued[step] = last[track] = max(earliest, last.get(track, -slots) + slots)
        earliest = int(issued[step]) + plan.interval
    return issued + START + results(plan) + EXIT


def held_back(plan: Plan) -> int:
    """How many steps are taken while no result is: a queue of results, one at the exit, steps that wait."""
    return queue_places(plan) + _OFFERED + _waiting(plan) + _HELD


def on_the_way(plan: Plan, *, steady: bool) -> int:
    """How many results may be on the way while the entrance surely takes another step.

    Steps wait in the register at the entrance and in the second place for them, unless the sender is not
    ``steady`` and left a gap between the two; the others have started since the result before theirs did.
    Steps of a sender that pauses may all have come after that result, and wait for the first of them.
    """
    clocks = return_clocks(plan)
    started = (START + results(plan) + EXIT) // clocks if steady or clocks == 1 else 0
    return 1 + (1 + steady if _waiting(plan) else 0) + started


def in_full_flow(plan: Plan) -> int:
    """How many results are on the way when tracks come in turn, and nobody pauses."""
    return (START + results(plan) + EXIT) // plan.interval


def never_waits(plan: Plan) -> bool:
    """Whether no step waits for the one of its track before it, when tracks come in turn."""
    return plan.channels * plan.interval >= return_clocks(plan)


def accepted_again(plan: Plan, clock: int) -> int:
    """The clock in which a full hardware takes the next step, its first result being taken in ``clock``."""
    return next_slot(plan, clock + RETURN) + 1


def queue_places(plan: Plan) -> int:
    """Results that the queue holds: what comes at the full rate, and a power of two."""
    places = -(-(results(plan) + 1 + _QUEUE) // plan.interval)
    return 1 << max(places - 1, 1).bit_length()


def results(plan: Plan) -> int:
    """The cycle of a step in which its result is there."""
    return max((plan.end(index) for _, index in plan.typed.graph.outputs), default=0)


def waits(plan: Plan) -> bool:
    """Whether a step may have to wait for the one of its track before it."""
    return return_clocks(plan) > plan.interval


def _waiting(plan: Plan) -> int:
    return _WAITING if waits(plan) else 0


def return_clocks(plan: Plan) -> int:
    """Clocks between two steps of a track: a step starts in one clock of every interval only."""
    return -(-plan.distance // plan.interval) * plan.interval


def next_slot(plan: Plan, clock: int) -> int:
    """The first clock from one on in which a step may start; the first after reset has passed an interval."""
    if plan.interval == 1:
        return clock
    return max(1, -(-clock // plan.interval)) * plan.interval
