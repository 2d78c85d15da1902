"""A plan prints as text that a reader follows, and parses back to the same plan."""
# ruff: noqa: E501

import pytest
from devices import PLAUSIBLE, UNIT
from graphs import Builder, alpha_beta, typed_graphs
from hypothesis import given, settings
from hypothesis import strategies as st

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.errors import DesignError
from kalmanhdl.graph.operations import Input, State
from kalmanhdl.numerics.text import parse_typed_graph, print_typed_graph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.text import parse_plan, print_plan, table
from planning import planned


def _halving() -> TypedGraph:
    b = Builder(TableNewton(index_bits=4, iterations=1))
    form = Fixed(width=8, fraction=4)
    x, z = b.source(State("x"), form), b.source(Input("z"), form)
    root = b.quantise(b.shift(b.multiply(x, z), -1), form, Rounding.HALF_EVEN, Overflow.SATURATE)
    return b.typed({"x": root}, {"my output": root}, Rounding.HALF_UP)


TEXT = """\
interval = 1
channels = 1
distance = 1
context_overhead = 0
recurrence_bound = 2
least_interval = 1
least_latency = 1
period_ns = 8.093
pipelined_period_ns = 5.1
operations
    0  0   %0 = state x : fixed(8, fraction=4) [-128, 127]  # state: 0,0
    0  0   %1 = input z : fixed(8, fraction=4) [-128, 127]  # input: 1,0
    0  0 * %2 = multiply %0 %1 : fixed(16, fraction=8) [-16256, 16384]  # multiply: 2,0
    0  0   %3 = shift %2 -1 : fixed(16, fraction=9) [-16256, 16384]  # shift: 0,1
    0  0   %4 = quantise %3 fixed(8, fraction=4) half_even saturate : fixed(8, fraction=4) [-128, 127]  # quantise: 1,1
states
x = %4
outputs
"my output" = %4
division
table_newton(index_bits=4, iterations=1) half_up
multiplication
in logic booth
violations
scales
x = 0.25
"my output" = 0.5
z = 1.0
"""


def test_a_plan_as_text():
    assert print_plan(planned(_halving(), PLAUSIBLE, 1, 1)) == TEXT


def test_the_text_is_the_plan():
    assert parse_plan(TEXT) == planned(_halving(), PLAUSIBLE, 1, 1)


@settings(max_examples=60, deadline=None)
@given(typed_graphs(), st.sampled_from((1, 3)))
def test_every_plan_parses_back(typed: TypedGraph, channels: int):
    plan = planned(typed, UNIT, None, channels)
    assert parse_plan(print_plan(plan)) == plan


@settings(max_examples=60, deadline=None)
@given(typed_graphs())
def test_every_typed_graph_parses_back(typed: TypedGraph):
    assert parse_typed_graph(print_typed_graph(typed)) == typed


@pytest.mark.parametrize(
    ("written", "instead", "message"),
    [
        (
            "interval = 1",
            "interval = one",
            "line 1: 'interval = one' is not understood: write 'interval = ' and",
        ),
        ("channels = 1\n", "", "line 2: 'distance = 1' is not understood: write 'channels = ' and a number"),
        ("operations\n", "", "the text has no section 'operations'"),
        ("    0  0   %1", "    0      %1", "line 12: '0      %1 = input z"),
        (
            "fixed(8, fraction=4) [-128, 127]  # state",
            "fixed(8) [-128, 127]  # state",
            "line 11: '%0 = state x",
        ),
        ("[-16256, 16384]  # shift", "# shift", "line 14: '%3 = shift"),
        ("table_newton(index_bits=4", "table_newton(bits=4", "line 21: 'table_newton(bits=4"),
        ("half_up", "up", "line 21"),
        (
            "logic booth",
            "logic",
            "line 23: 'in logic' is not understood: write 'in logic booth' or 'in logic w",
        ),
        ("violations\n", "", "the text has no section 'violations'"),
        (
            "violations\n",
            "violations\n%4\n",
            "line 25: '%4' is not understood: write '%4 %5 starting running'",
        ),
        ("z = 1.0", "z = fast", "line 28: 'z = fast' is not understood: write 'x[0] = 0.5'"),
        ("saturate :", "stop :", "line 15"),
        ("multiply %0 %1", "multiply %0 %7", "write operands that stand before %2"),
    ],
)
def test_a_line_that_is_not_understood_is_named(written: str, instead: str, message: str):
    assert written in TEXT
    with pytest.raises(DesignError) as error:
        parse_plan(TEXT.replace(written, instead, 1))
    assert message in str(error.value)


def test_the_table_tells_what_starts_when():
    assert table(planned(alpha_beta(), PLAUSIBLE, 2, 1)) == (
        "interval 2, channels 1, recurrence bound 9, distance 2, latency 2 cycles of 24.41 ns\n"
        "cycle  operations that start\n"
        "    0  add 1, input 1, quantise 1, reciprocal 1, state 1\n"
        "    1  add 1, multiply 3, quantise 2, state 1, subtract 1\n"
    )
