"""Schedules and places are held to what the hardware can do, by lines of their own."""

from collections import Counter
from itertools import pairwise

import pytest
from images import ROOMY, fitting

from kalmanhdl.programmable.allocation import allocated
from kalmanhdl.programmable.control import OPERANDS, QUOTIENT_BITS_PER_CLOCK, written_after
from kalmanhdl.programmable.operations import Fixture, Kept, Result
from kalmanhdl.programmable.schedule import OUTPUT, file_of

SEEDS = (0, 1, 11, 16, 22, 28, 50, 58)


def reads(schedule):
    """Every read: the file, the word, the row."""
    for operation, unit, row in zip(schedule.step.operations, schedule.units, schedule.starts, strict=True):
        for place, word in enumerate(operation.operands):
            yield file_of(ROOMY, unit, place), word, row


@pytest.mark.parametrize("seed", SEEDS)
def test_units_and_files_do_one_thing_a_row(seed):
    schedule = fitting(seed).image.schedule
    busy, written = Counter(), Counter()
    for k, operation in enumerate(schedule.step.operations):
        clocks = 1
        if operation.exponent is not None:
            # As many clocks as the quotient has bits to come, and one in which the next is taken.
            clocks -= -(operation.exponent + 1) // QUOTIENT_BITS_PER_CLOCK
        busy.update((schedule.units[k], schedule.starts[k] + row) for row in range(clocks))
        assert schedule.units[k].startswith(operation.kind.value)
        row = schedule.starts[k] + written_after(operation)
        assert operation.exponent is None or row == schedule.starts[k] + OPERANDS + clocks
        assert row == schedule.written[k] < schedule.rows <= ROOMY.rows
        written.update((file, row) for file in schedule.targets[k])
    assert max(busy.values()) == max(written.values()) == 1


@pytest.mark.parametrize("seed", SEEDS)
def test_a_word_is_there_when_it_is_read_and_until_it_was(seed):
    schedule = fitting(seed).image.schedule
    places = allocated(schedule, ROOMY)
    taken = {}
    for file, word, row in reads(schedule):
        if isinstance(word, Result):
            assert schedule.written[word.operation] < row
            assert file in schedule.targets[word.operation]
        if isinstance(word, Result) and word in places[file].passing:
            span = taken.setdefault((file, places[file].passing[word]), {})
            first, last = span.get(word, (schedule.written[word.operation], row))
            span[word] = first, max(last, row)
    for spans in taken.values():
        ordered = sorted(spans.values())
        assert all(before[1] < after[0] for before, after in pairwise(ordered))


@pytest.mark.parametrize("seed", SEEDS)
def test_every_word_of_a_file_has_a_place_of_its_own(seed):
    schedule = fitting(seed).image.schedule
    for file, places in allocated(schedule, ROOMY).items():
        banks = [place + bank for place in places.states.values() for bank in (0, 1)]
        alone = [*banks, *places.fixed.values()]
        assert len(set(alone)) == len(alone)
        assert not set(alone) & set(places.passing.values())
        assert all(place % 2 == 0 for place in places.states.values())
        assert max([*alone, *places.passing.values()], default=-1) < places.used <= ROOMY.words
        words = {word for name, word, _ in reads(schedule) if name == file}
        assert set(places.fixed) == {word for word in words if isinstance(word, Fixture)}
        assert set(places.states) == {word for word in words if isinstance(word, Kept)}


@pytest.mark.parametrize("seed", SEEDS)
def test_states_and_outputs_are_written_where_they_are_wanted(seed):
    bound = fitting(seed)
    schedule, step = bound.image.schedule, bound.image.schedule.step
    for file, word, _ in reads(schedule):
        if isinstance(word, Kept):
            assert file in schedule.targets[step.states[word]]
    assert all(OUTPUT in schedule.targets[operation] for operation in step.outputs.values())
    assert set(step.outputs) == {name for name, _ in bound.typed.graph.outputs} - {"saturated"}
    assert len(set(step.states.values())) == len(step.states)
