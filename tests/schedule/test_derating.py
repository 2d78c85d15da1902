"""Kinds of operators that took longer than the table says get the latency that this needs."""

from dataclasses import replace

import pytest
from devices import PLAUSIBLE, UNIT
from graphs import WORD, Builder, alpha_beta, typed_graphs
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.errors import ScheduleError
from kalmanhdl.graph.kinds import KINDS
from kalmanhdl.graph.operations import Add, Input, Multiply
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.operators import operators
from kalmanhdl.schedule.placement import step_of
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.text import parse_plan, print_plan
from kalmanhdl.target.device import DERATED, Device
from planning import planned

devices = st.sampled_from((UNIT, PLAUSIBLE))
factors = st.dictionaries(st.sampled_from(DERATED), st.floats(1, 4), max_size=4)


@settings(max_examples=100, deadline=None)
@given(typed_graphs(), devices, factors, st.sampled_from((None, 1, 3, 7)), st.sampled_from((1, 2, 16)))
def test_every_architecture_has_a_schedule_without_problems(
    typed: TypedGraph, device: Device, derate: dict[str, float], interval: int | None, channels: int
):
    part = replace(device, derate=derate)
    plan = planned(typed, part, interval, channels, None)
    assert problems(plan, part) == []
    # No piece of logic became longer by it, so that the clock that is expected did not.
    shortest = step_of(typed, part, channels, plan.on_multiplier_block).shortest_period / 1000
    assert shortest <= step_of(typed, device, channels, plan.on_multiplier_block).shortest_period / 1000
    assert plan.shallower or plan.period_ns <= max(device.pipelined_period_ns, shortest)


@settings(max_examples=60, deadline=None)
@given(
    typed_graphs(), devices, factors, st.dictionaries(st.sampled_from(KINDS), st.integers(1, 2), min_size=1)
)
def test_shared_operators_have_a_schedule_without_problems(
    typed: TypedGraph, device: Device, derate: dict[str, float], units: dict[str, int]
):
    part = replace(device, derate=derate)
    try:
        plan = planned(typed, part, None, 1, units=units)
    except ScheduleError as error:
        assume("cannot share" not in str(error))
        raise
    assert problems(plan, part) == []
    assert parse_plan(print_plan(plan)) == plan


def test_a_chain_is_cut_where_it_took_too_long():
    build = Builder()
    a, b, c = (build.source(Input(name), WORD) for name in "abc")
    total = build.sum(Add, build.sum(Add, a, b), c)
    typed = build.typed({}, {"y": total}, Rounding.FLOOR)
    chained = planned(typed, PLAUSIBLE, None, 1, None)
    part = replace(PLAUSIBLE, derate={"add": 2.0})
    cut = planned(typed, part, None, 1, None)
    assert problems(cut, part) == []
    assert (chained.latency, cut.latency) == (1, 2)
    assert cut.registers == chained.registers


def test_operands_that_are_slow_to_choose_are_chosen_in_two_steps():
    typed, units = alpha_beta(), {"multiply": 1}
    one = planned(typed, PLAUSIBLE, None, 1, units=units)
    part = replace(PLAUSIBLE, derate={"operands": 9.0})
    two = planned(typed, part, None, 1, units=units)
    assert problems(two, part) == []
    assert ([unit.steps for unit in one.units], [unit.steps for unit in two.units]) == ([1], [2])
    operation = two.units[0].operations[0]
    assert two.registers[operation] == one.registers[operation] + 1
    assert "\n  multiply/2 %" in print_plan(two)


def test_what_cannot_be_cut_has_its_stage_for_itself():
    typed, part = alpha_beta(), replace(PLAUSIBLE, derate={"multiply": 3.0})
    plan = planned(typed, part, None, 1, None)
    assert problems(plan, part) == []
    assert plan.period_ns <= PLAUSIBLE.pipelined_period_ns
    products = [k for k, o in enumerate(typed.graph.operations) if isinstance(o, Multiply)]
    on_block = [k for k in products if k in plan.on_multiplier_block]
    assert on_block
    assert all(plan.registers[k] == _library(plan, part)[k].capacity for k in on_block)


def test_operators_take_more_registers_the_longer_they_took():
    held = []
    for factor in (1.0, 1.5, 2.0, 4.0):
        part = replace(PLAUSIBLE, derate={"divide": factor, "reciprocal": factor})
        plan = planned(alpha_beta(), part, None, 1, None)
        held.append(sum(plan.registers))
    assert held == sorted(held)
    assert held[0] < held[-1]


def _library(plan: Plan, part: Device):
    return operators(plan.typed, part, plan.on_multiplier_block, plan.sharing)


@pytest.mark.parametrize("kind", ["operand", "state", "constant", "input"])
def test_only_operators_are_derated(kind):
    assert kind not in DERATED
