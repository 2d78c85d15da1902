"""Operands that wait in memories are still there when an operator takes them."""

from dataclasses import replace

from devices import PLAUSIBLE
from graphs import typed_graphs
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kalmanhdl import pipeline
from kalmanhdl.design import Architecture, Design
from kalmanhdl.errors import ScheduleError
from kalmanhdl.graph.kinds import KINDS
from kalmanhdl.pipeline import fixed_numbers
from kalmanhdl.schedule.storage import ports
from planning import planned

STEPS = 9


def read_wrongly(plan, spoiled=lambda file: file):
    """Reads that find another value than the step's own, when steps come at the full rate."""
    wrong = []
    for unit in plan.units:
        for port in ports(plan, unit):
            for number, file in enumerate(map(spoiled, port.files)):
                place = {(value, e.shift): e for value, e in file.kept}
                events = []
                for step in range(STEPS):
                    begin = step * plan.interval
                    for entry in file.entries:
                        # What is written in a clock can be read in the next.
                        events.append(
                            (begin + entry.written, 1, step, entry.slot, (step, entry.values, entry.shift))
                        )
                    for read in port.reads:
                        if read.file == number:
                            entry = place[read.value, read.shift]
                            kept = (step, entry.values, entry.shift)
                            events.append((begin + read.cycle, 0, step, entry.slot, kept))
                held = {}
                clocks = [(clock, kind) for clock, kind, *_ in events if kind]
                assert len(clocks) == len(set(clocks)), "two values written in one clock"
                for _, writes, step, slot, value in sorted(events):
                    if writes:
                        held[step % file.turns, slot] = value
                    elif held.get((step % file.turns, slot)) != value:
                        wrong.append(value)
    return wrong


@settings(max_examples=60, deadline=None)
@given(
    typed_graphs(),
    st.sampled_from((1, 2, 5)),
    st.dictionaries(st.sampled_from(KINDS), st.integers(1, 2), min_size=1),
)
def test_every_operand_is_there_in_its_turn(typed, channels, units):
    try:
        plan = planned(typed, PLAUSIBLE, None, channels, units=units)
    except ScheduleError as error:
        assume("cannot share" not in str(error))
        raise
    assert read_wrongly(plan) == []


def test_values_that_share_one_place_are_seen():
    design = Design.load("designs/lee1997.toml")
    typed = fixed_numbers(design).typed
    plan = planned(typed, PLAUSIBLE, None, 1, units={"multiply": 1, "add": 2})

    def spoiled(file):
        return replace(file, entries=tuple(replace(entry, slot=0) for entry in file.entries))

    assert read_wrongly(plan) == []
    assert read_wrongly(plan, spoiled)


def test_values_that_are_one_integer_on_one_wire_are_kept_once():
    design = Design.load("designs/liu2007_bierman_thornton.toml")
    one = replace(design, architecture=Architecture(units={"multiply_add": 1, "multiply": 1}))
    plan = pipeline.planned(one, pipeline.numbers_of(one))
    files = [file for unit in plan.units for port in ports(plan, unit) for file in port.files]
    assert any(len(entry.values) > 1 for file in files for entry in file.entries)
    assert read_wrongly(plan) == []
