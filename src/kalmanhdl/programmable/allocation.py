"""Where words stand in their files."""

from collections.abc import Mapping
from dataclasses import dataclass

from kalmanhdl.errors import ScheduleError
from kalmanhdl.programmable.operations import Fixture, Kept, Result, Word
from kalmanhdl.programmable.schedule import Schedule, power_of_two
from kalmanhdl.shape import Shape


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """The words of one file by their addresses.

    ``fixed`` stand there from the image on, ``states`` have an even address and the one above it in turn,
    ``passing`` are results of the step. A result that a state takes stands where that state is written.
    """

    fixed: Mapping[Fixture, int]
    states: Mapping[Kept, int]
    passing: Mapping[Result, int]
    used: int


def allocated(schedule: Schedule, shape: Shape) -> dict[str, Places]:
    """The places in every file. Raises ScheduleError where a file has too few words."""
    found = {file: _file(schedule, file, words) for file, words in schedule.reads.items()}
    fullest = max(found, key=lambda file: found[file].used)
    used = found[fullest].used
    if used > shape.words:
        raise ScheduleError(
            f"the file {fullest} takes {used} words, and it has {shape.words}: build hardware with "
            f"[architecture] words = {power_of_two(used)}, or with more units"
        )
    return found


def _file(schedule: Schedule, file: str, words: Mapping[Word, int]) -> Places:
    kept = sorted(
        (word for word in words if isinstance(word, Kept)), key=lambda word: (word.state, word.lift)
    )
    states = {word: 2 * k for k, word in enumerate(kept)}
    taken = 2 * len(kept)
    raws = sorted((word for word in words if isinstance(word, Fixture)), key=lambda word: word.raw)
    fixed = {word: taken + k for k, word in enumerate(raws)}
    taken += len(fixed)
    stored = {schedule.step.states[word] for word in kept}
    passing: dict[Result, int] = {}
    # By when they are written; the row in which a place is read last is not the one in which it is written.
    free_from: list[int] = []
    results = (word for word in words if isinstance(word, Result) and word.operation not in stored)
    for word in sorted(results, key=lambda each: schedule.written[each.operation]):
        written, last = schedule.written[word.operation], words[word]
        place = next((k for k, free in enumerate(free_from) if free < written), len(free_from))
        if place == len(free_from):
            free_from.append(last)
        free_from[place] = last
        passing[word] = taken + place
    return Places(fixed=fixed, states=states, passing=passing, used=taken + len(free_from))
