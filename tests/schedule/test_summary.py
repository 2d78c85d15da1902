"""The numbers of a plan that a report shows."""

from devices import PLAUSIBLE, UNIT
from graphs import alpha_beta, typed_graphs
from hypothesis import given, settings

from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.summary import Row, summarise
from planning import planned


def test_units_and_blocks_of_a_filter():
    summary = summarise(planned(alpha_beta(), PLAUSIBLE, None, 1), PLAUSIBLE)
    assert summary.units == {"add": 2, "multiply": 3, "quantise": 3, "reciprocal": 1, "subtract": 1}
    assert summary.multiplier_blocks == 3
    assert sum(sum(kinds.values()) for kinds in summary.busy) == len(summary.rows)
    assert Row(label="%8", kind="multiply", start=7, end=7, origin="multiply: 2,2") in summary.rows


def test_the_loop_that_sets_the_bound_is_named():
    assert summarise(planned(alpha_beta(), PLAUSIBLE, None, 1), PLAUSIBLE).loop == ("P",)


def test_a_shallower_pipeline_names_the_loop_that_sets_its_period():
    summary = summarise(planned(alpha_beta(), PLAUSIBLE, 3, 1), PLAUSIBLE)
    assert summary.shallower
    assert summary.loop == ("P",)


@settings(max_examples=40, deadline=None)
@given(typed_graphs())
def test_every_plan_has_numbers(typed: TypedGraph):
    plan = planned(typed, UNIT, None, 1)
    summary = summarise(plan, UNIT)
    assert all(0 <= row.start <= row.end for row in summary.rows)
    assert summary.register_bits >= 0
    assert summary.latency_cycles == plan.latency == len(summary.busy)
