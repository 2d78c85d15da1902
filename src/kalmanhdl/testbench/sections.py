"""Which steps a test bench sends, and how its streams pause."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.model.model import Model
from kalmanhdl.rtl.interface import Interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.commands import Command
from kalmanhdl.verify import timing
from kalmanhdl.verify.clocks import clocks_of
from kalmanhdl.verify.stimulus import Steps, from_model, random_steps

# Steps of a section in all streams, where they do not take more clocks than that; at least so many then.
_STEPS, _CLOCKS, _FEWEST = 120, 3000, 24
# Steps that come after those that fill the hardware up, and those that a reset drops, of each stream.
_MORE, _DROPPED = 12, 2
# Tracks that the model draws: so many of the first and of the last.
_ENDS = 4
_PAUSE = 0.25
# Clocks beside what the schedule tells.
_MARGIN = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Steps after a reset, and how the streams pause.

    ``pause`` is how often either side pauses before it offers a step or takes a result. ``held``: so many
    clocks pass before the first result is taken. ``dropped``: no result is taken, and the reset of the
    next section drops them all. ``wait``: so many clocks pass after the last transfer.
    """

    name: str
    steps: Steps
    pause: float = 0.0
    held: int = 0
    dropped: bool = False
    wait: int

    @property
    def calm(self) -> bool:
        """Whether nobody pauses, so that it is known when each result comes."""
        return not (self.pause or self.held or self.dropped)


def sections(model: Model, plan: Plan, shown: Interface, seed: int = 1) -> tuple[Section, ...]:
    """The sections of a design's test bench, in the order in which they run."""
    typed, tracks, streams = plan.typed, plan.channels * shown.lanes, len(shown.streams)
    clocks, count = clocks_of(plan, shown), _count(plan)
    rest = timing.results(plan) + _MARGIN
    filling = (clocks.held_back + _MORE) * streams
    dropped = min(_DROPPED * streams, tracks)
    full = random_steps(typed, filling, tracks, seed + 2, in_turn=True)
    few = random_steps(typed, dropped, tracks, seed + 3, in_turn=True)
    # Nobody pauses and tracks come in any order: it shows by the clock when each step waits for its track.
    again = random_steps(typed, count, tracks, seed + 4)
    return (
        Section(name="model", steps=_from_model(model, plan, shown, count, seed), wait=rest),
        Section(name="random", steps=random_steps(typed, count, tracks, seed + 1), pause=_PAUSE, wait=rest),
        Section(name="full", steps=full, held=_done(plan, shown, full), wait=rest),
        Section(name="dropped", steps=few, dropped=True, wait=_done(plan, shown, few)),
        Section(name="after", steps=again, wait=rest),
    )


def of_stream(steps: Steps, shown: Interface, stream: int) -> Steps:
    """The steps that go through one of the pairs of streams."""
    if len(shown.streams) == 1:
        return steps
    return replace(steps, order=steps.order[steps.tracks % shown.lanes == stream])


def handed_over(steps: Steps, plan: Plan, shown: Interface) -> NDArray[np.int64]:
    """The clock of each result of the steps of one pair of streams that never pause."""
    tracks = steps.tracks if len(shown.streams) == 1 else steps.tracks // shown.lanes
    return clocks_of(plan, shown).handed_over(tracks)


def _count(plan: Plan) -> int:
    """Steps of a section; a track's step comes at its full distance, or right after another track's."""
    clocks = plan.interval + timing.return_clocks(plan)
    return max(_FEWEST, min(_STEPS, 2 * _CLOCKS // clocks))


def _done(plan: Plan, shown: Interface, steps: Steps) -> int:
    """Clocks after which steps are done, states and all, whether or not their results are taken."""
    each = (of_stream(steps, shown, stream) for stream in range(len(shown.streams)))
    last = max(int(handed_over(own, plan, shown).max(initial=0)) for own in each)
    return last + plan.distance + _MARGIN


def _from_model(model: Model, plan: Plan, shown: Interface, count: int, seed: int) -> Steps:
    """Steps of tracks that the model draws: of the first and last tracks, in as many lanes as there are."""
    tracks, ends = plan.channels * shown.lanes, max(_ENDS, shown.lanes)
    chosen = np.array(sorted({*range(min(ends, tracks)), *range(max(0, tracks - ends), tracks)}))
    drawn = from_model(model, plan.typed, count, len(chosen), seed)

    def spread(array: NDArray[Any], nothing: int = 0) -> NDArray[Any]:
        wide = np.full((len(array), tracks), nothing, array.dtype)
        wide[:, chosen] = array
        return wide

    return Steps(
        commands=spread(drawn.commands, Command.NONE),
        inputs={name: spread(raws) for name, raws in drawn.inputs.items()},
        flags={name: spread(flags) for name, flags in drawn.flags.items()},
        order=drawn.order // len(chosen) * tracks + chosen[drawn.tracks],
        offered={name: spread(flags) for name, flags in drawn.offered.items()},
    )
