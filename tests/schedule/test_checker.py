"""The checker finds what is wrong with a plan, and says it in words."""

from dataclasses import replace

import pytest
from devices import PLAUSIBLE, UNIT
from graphs import alpha_beta, typed_graphs
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kalmanhdl.design import Design
from kalmanhdl.graph.operations import Constant, Reciprocal, State, operands
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.pipeline import numbers_of
from kalmanhdl.pipeline import planned as planned_design
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.plan import Plan
from planning import planned


def _moved(plan: Plan, index: int, start: int) -> Plan:
    return replace(plan, start=(*plan.start[:index], start, *plan.start[index + 1 :]))


def _holding(plan: Plan, index: int, registers: int) -> Plan:
    return replace(plan, registers=(*plan.registers[:index], registers, *plan.registers[index + 1 :]))


PLAN = planned(alpha_beta(), PLAUSIBLE, None, 1)
GAIN = next(k for k, o in enumerate(PLAN.typed.graph.operations) if isinstance(o, Reciprocal))
READ = next(k for k, o in enumerate(PLAN.typed.graph.operations) if o == State("P"))
ROOT = dict(PLAN.typed.graph.states)["P"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (_moved(PLAN, ROOT, 0), "%12 Quantise (quantise: 0,4) starts in cycle 0, before its operand"),
        (_moved(PLAN, GAIN, -1), "start of %6 Reciprocal (reciprocal: 0,2) is -1: use 0 or more"),
        (_holding(PLAN, GAIN, PLAN.registers[GAIN] - 1), "ends a stage of"),
        (_holding(PLAN, GAIN, PLAN.registers[GAIN] + 3), "before its operand"),
        (_holding(PLAN, GAIN, 40), "holds 40 registers, but has room for"),
        (_holding(PLAN, READ, 1), "holds 1 registers, but has room for 0"),
        (_moved(PLAN, ROOT, PLAN.start[ROOT] + 5), "too late for a next step"),
        (_moved(PLAN, READ, PLAN.end(ROOT) + 1), "state P is read in cycle"),
        (_moved(PLAN, 2, 1), "%2 Input (input: 2,0) comes with the step but ends in cycle 1"),
        (replace(PLAN, interval=PLAN.interval - 1), "sooner than the distance of"),
        (replace(PLAN, interval=0), "interval 0 and channels 1: both are 1 or more"),
        (replace(PLAN, distance=PLAN.distance - 1), "reaches the distance of"),
        (replace(PLAN, recurrence_bound=PLAN.recurrence_bound - 1), "reaches the bound of"),
        (replace(PLAN, recurrence_bound=PLAN.recurrence_bound + 1), "is not the least"),
        (replace(PLAN, context_overhead=1), "a context of 1 channels cannot have an overhead of 1"),
        (replace(PLAN, period_ns=PLAN.period_ns - 0.1), "longer than the period of"),
        (replace(PLAN, start=PLAN.start[:-1]), "start has 13 entries for 14 operations"),
    ],
)
def test_a_wrong_plan_is_told_by_what_is_wrong(wrong: Plan, message: str):
    found = problems(wrong, PLAUSIBLE)
    assert any(message in problem for problem in found), found


def test_what_leaves_on_buses_is_told_by_what_is_wrong():
    design = Design.load("designs/liu2007_bierman_thornton.toml")
    plan, part = planned_design(design, numbers_of(design)), design.target.part
    assert problems(plan, part) == []
    first, *others = plan.buses
    assert others
    without = replace(plan, buses=(first[1:], *others))
    assert "the buses do not carry every sum of products once" in problems(without, part)
    crowded = replace(plan, buses=(tuple(index for bus in plan.buses for index in bus),))
    assert any("both leave on bus 0 in cycle" in problem for problem in problems(crowded, part))


@settings(max_examples=60, deadline=None)
@given(typed_graphs(), st.data())
def test_an_operation_moved_before_its_operand_is_found(typed: TypedGraph, data: st.DataObject):
    plan = planned(typed, UNIT, None, 1)
    operations = typed.graph.operations
    bound = [
        k
        for k, operation in enumerate(operations)
        if any(not isinstance(operations[p], Constant) and plan.end(p) > 0 for p in operands(operation))
    ]
    assume(bound)
    index = data.draw(st.sampled_from(bound))
    operands_end = max(
        plan.end(p) for p in operands(operations[index]) if not isinstance(operations[p], Constant)
    )
    assert problems(_moved(plan, index, operands_end - 1), UNIT)


@settings(max_examples=60, deadline=None)
@given(typed_graphs(), st.data())
def test_a_register_dropped_from_an_operator_is_found(typed: TypedGraph, data: st.DataObject):
    plan = planned(typed, UNIT, None, 1, clock_mhz=250.0)
    held = [k for k, registers in enumerate(plan.registers) if registers]
    assume(held)
    index = data.draw(st.sampled_from(held))
    # The scheduler gives an operator no register that the period does not need.
    assert problems(_holding(plan, index, plan.registers[index] - 1), UNIT)


@settings(max_examples=40, deadline=None)
@given(typed_graphs(), st.sampled_from((1, 4)))
def test_a_distance_below_the_bound_is_found(typed: TypedGraph, channels: int):
    plan = planned(typed, PLAUSIBLE, None, channels)
    assert problems(replace(plan, distance=plan.distance - 1), PLAUSIBLE)
    assert problems(replace(plan, recurrence_bound=plan.recurrence_bound - 1), PLAUSIBLE)
