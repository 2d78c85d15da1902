"""Shared operators that work for several clocks on one operation."""

import pytest
from devices import PLAUSIBLE
from graphs import alpha_beta, typed_graphs
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.design import Architecture
from kalmanhdl.errors import DesignError, ScheduleError
from kalmanhdl.graph.kinds import ITERATIVE
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.text import parse_plan, print_plan
from kalmanhdl.schedule.wanted import Wanted


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    typed_graphs(),
    st.sampled_from((1, 3)),
    st.dictionaries(st.sampled_from(ITERATIVE), st.integers(1, 2), min_size=1),
    st.sampled_from((0.0, 0.1)),
)
def test_operations_wait_until_an_iterative_operator_is_free(
    typed: TypedGraph, channels: int, units: dict[str, int], seconds: float
):
    kinds = tuple(units)
    try:
        plan = schedule(
            typed,
            PLAUSIBLE,
            Wanted(channels=channels, units=units, iterative=kinds, solver_seconds=seconds),
        )
    except ScheduleError as error:
        assume("by a table" not in str(error) and "cannot share" not in str(error))
        raise
    assert problems(plan, PLAUSIBLE) == []
    assert all(unit.busy > 1 for unit in plan.units if unit.kind in kinds)
    assert parse_plan(print_plan(plan)) == plan


def test_an_operation_alone_is_iterative_too():
    wanted = Wanted(units={"reciprocal": 1}, iterative=("reciprocal",))
    (unit,) = schedule(alpha_beta(LongDivision()), PLAUSIBLE, wanted).units
    assert (unit.kind, len(unit.operations)) == ("reciprocal", 1)
    assert unit.busy > 4


def test_reciprocals_by_a_table_are_not_iterative():
    wanted = Wanted(units={"reciprocal": 1}, iterative=("reciprocal",))
    with pytest.raises(ScheduleError, match="by a table are not iterative"):
        schedule(alpha_beta(TableNewton(index_bits=6, iterations=1)), PLAUSIBLE, wanted)


@pytest.mark.parametrize(
    ("units", "iterative", "message"),
    [
        ({"multiply": 1}, ("square",), "iterative.*'square'|square"),
        ({"multiply": 1}, ("divide",), "how many there are is said by units"),
        (None, ("multiply",), "how many there are is said by units"),
    ],
)
def test_kinds_that_cannot_be_iterative_are_refused(units, iterative, message):
    with pytest.raises(DesignError, match=message):
        Architecture(units=units, iterative=iterative)
