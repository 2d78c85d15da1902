"""Schedules of any graph keep what a plan promises, and reach the bound of their loops."""

from dataclasses import replace
from itertools import pairwise

import pytest
from devices import PLAUSIBLE, UNIT
from graphs import WORD, Builder, alpha_beta, typed_graphs
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kalmanhdl.arithmetic.division import LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.errors import ScheduleError
from kalmanhdl.graph.kinds import KINDS
from kalmanhdl.graph.operations import Add, Input, Multiply, State, Subtract
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.operators import operators, shared_operator
from kalmanhdl.target.device import Device
from planning import planned

devices = st.sampled_from((UNIT, PLAUSIBLE))


@settings(max_examples=100, deadline=None)
@given(
    typed_graphs(),
    devices,
    st.sampled_from((None, 1, 2, 3, 7)),
    st.sampled_from((1, 2, 4, 16)),
    st.sampled_from((None, 20.0, 100.0, 500.0)),
    st.sampled_from((None, 0, 2)),
)
def test_every_architecture_of_every_graph_has_a_schedule_without_problems(
    typed: TypedGraph,
    device: Device,
    interval: int | None,
    channels: int,
    clock_mhz: float | None,
    blocks: int | None,
):
    plan = planned(typed, device, interval, channels, clock_mhz, blocks)
    assert problems(plan, device) == []
    assert plan.channels == channels
    assert interval is None or plan.interval == interval


@settings(max_examples=100, deadline=None)
@given(
    typed_graphs(),
    devices,
    st.sampled_from((1, 2, 5)),
    st.dictionaries(st.sampled_from(KINDS), st.integers(1, 3)),
)
def test_operations_take_turns_on_as_many_operators_as_there_are(
    typed: TypedGraph, device: Device, channels: int, units: dict[str, int]
):
    try:
        plan = planned(typed, device, None, channels, units=units)
    except ScheduleError as error:
        assume("cannot share" not in str(error))
        raise
    assert problems(plan, device) == []
    assert plan.interval >= plan.sharing.bound
    for kind, count in plan.sharing.counts.items():
        limit, found = units.get(kind, units.get("divide")), len(plan.sharing.operations[kind])
        # Sums of products have no other operator, however few they are.
        assert count == min(limit, found) if kind == "multiply_add" else count == limit < found


@settings(max_examples=40, deadline=None)
@given(typed_graphs(), devices, st.sampled_from((2, 3, 8, 20)), st.sampled_from((1, 4)))
def test_an_interval_is_met_with_fewer_operators(
    typed: TypedGraph, device: Device, interval: int, channels: int
):
    plan = planned(typed, device, interval, channels, units=None)
    assert problems(plan, device) == []
    assert plan.interval == interval
    assert all(len(unit.operations) <= interval for unit in plan.units)


@settings(max_examples=30, deadline=None)
@given(typed_graphs(), devices, st.sampled_from((1, 3, 16)))
def test_without_an_interval_a_track_runs_at_its_bound(typed: TypedGraph, device: Device, channels: int):
    plan = planned(typed, device, None, channels)
    assert plan.distance == plan.recurrence_bound
    assert plan.interval == -(-plan.recurrence_bound // channels)
    assert not plan.shallower


@settings(max_examples=12, deadline=None)
@given(typed_graphs(), devices)
def test_a_pipeline_made_shallower_is_as_deep_as_its_interval_allows(typed: TypedGraph, device: Device):
    deep = planned(typed, device, None, 1)
    # Interval 1 is apart: there the inputs, too, reach the states within the cycle.
    plans = [planned(typed, device, interval, 1) for interval in range(2, deep.recurrence_bound + 2)]
    assert all(plan.distance <= plan.interval for plan in plans)
    assert all(plan.shallower == (plan.interval < plan.recurrence_bound) for plan in plans)
    assert all(a.period_ns >= b.period_ns for a, b in pairwise(plans))
    assert planned(typed, device, 1, 1).distance == 1


@settings(max_examples=30, deadline=None)
@given(typed_graphs(), devices)
def test_a_single_cycle_computes_all_numbers_in_the_cycle_of_their_inputs(typed: TypedGraph, device: Device):
    plan = planned(typed, device, 1, 1)
    if plan.shallower:
        # What nothing reads again may be stored later.
        read = {o.name for o in typed.graph.operations if isinstance(o, State)}
        assert all(plan.end(root) == 0 for name, root in typed.graph.states if name in read)


def _loop_of(adders: int) -> TypedGraph:
    """A state that goes through so many adders of exact width, and comes back."""
    b = Builder()
    z = b.source(Input("z"), Fixed(width=4, fraction=0))
    value = b.source(State("x"), WORD)
    for _ in range(adders):
        value = b.sum(Add, value, z)
    root = b.quantise(value, WORD, Rounding.FLOOR, Overflow.WRAP)
    return b.typed({"x": root}, {"x": root}, Rounding.FLOOR)


@pytest.mark.parametrize("adders", [1, 2, 5, 12])
def test_the_bound_of_a_loop_is_its_length(adders: int):
    typed = _loop_of(adders)
    # On the unit device an adder fills a cycle.
    assert planned(typed, UNIT, None, 1).recurrence_bound == adders
    # A memory takes a cycle to read, one to write and one to turn round.
    assert planned(typed, UNIT, None, 4).recurrence_bound == adders + 3


@pytest.mark.parametrize(("clock_mhz", "bound"), [(1000, 12), (500, 6), (250, 3), (100, 2), (80, 1)])
def test_a_slower_clock_chains_more_in_a_cycle(clock_mhz: float, bound: int):
    plan = planned(_loop_of(12), UNIT, None, 1, clock_mhz)
    assert plan.recurrence_bound == bound
    assert plan.period_ns <= 1000 / clock_mhz


def test_two_states_that_feed_each_other_share_the_bound_of_their_loop():
    b = Builder()
    x, y = b.source(State("x"), WORD), b.source(State("y"), WORD)
    wide = [b.sum(Add, x, y), b.sum(Subtract, x, y)]
    long = b.sum(Add, b.sum(Add, y, b.constant(3, 8)), b.constant(5, 4))
    new_x = b.quantise(b.sum(Add, long, b.constant(7, 8)), WORD, Rounding.FLOOR, Overflow.WRAP)
    new_y = b.quantise(x, WORD, Rounding.FLOOR, Overflow.WRAP)
    typed = b.typed({"x": new_x, "y": new_y}, {"s": wide[0], "d": wide[1]}, Rounding.FLOOR)
    # Three adders and nothing over two steps: a step every ceil((3 + 1) / 2) cycles.
    assert planned(typed, UNIT, None, 1).recurrence_bound == 2


@pytest.mark.parametrize(
    "division", [LongDivision(), LongDivision(radix=4), TableNewton(index_bits=6, iterations=1)]
)
def test_a_filter_is_pipelined_to_the_period_of_the_device(division: LongDivision | TableNewton):
    plan = planned(alpha_beta(division), PLAUSIBLE, None, 1)
    assert plan.period_ns <= PLAUSIBLE.pipelined_period_ns
    assert plan.interval == plan.recurrence_bound > 5
    assert max(plan.registers) >= 3


def test_operators_too_long_for_the_clock_set_the_period():
    plan = planned(alpha_beta(), PLAUSIBLE, None, 1, clock_mhz=1000.0)
    # The multiplier block and its register.
    assert plan.period_ns == pytest.approx(4.2 + 0.9)


def test_interleaved_tracks_take_an_update_every_clock():
    plan = planned(alpha_beta(), PLAUSIBLE, 1, 16)
    assert (plan.interval, plan.shallower) == (1, False)
    assert plan.distance <= 16


def test_a_state_is_read_no_earlier_than_it_is_needed():
    plan = planned(alpha_beta(), PLAUSIBLE, None, 1)
    operations = plan.typed.graph.operations
    read = next(k for k, o in enumerate(operations) if o == State("x"))
    assert plan.start[read] == min(plan.start[k] for k in plan.typed.graph.users[read])


@settings(max_examples=40, deadline=None)
@given(typed_graphs(), devices, st.integers(1, 6), st.sampled_from((1, 4)))
def test_multiplier_blocks_stay_within_their_number(
    typed: TypedGraph, device: Device, blocks: int, channels: int
):
    plan = planned(typed, device, None, channels, multiplier_blocks=blocks)
    library = operators(typed, device, plan.on_multiplier_block)
    assert sum(library[k].blocks for k in plan.on_multiplier_block) <= blocks


def test_the_gain_keeps_its_block_before_an_output_does():
    typed = alpha_beta()
    operations = typed.graph.operations
    products = [k for k, o in enumerate(operations) if isinstance(o, Multiply)]
    square = dict(typed.graph.outputs)["square"]
    assert planned(typed, PLAUSIBLE, None, 1).on_multiplier_block == frozenset(products)
    assert square not in planned(typed, PLAUSIBLE, None, 1, multiplier_blocks=2).on_multiplier_block
    assert square not in planned(typed, PLAUSIBLE, 1, 1).on_multiplier_block
    assert planned(typed, PLAUSIBLE, None, 1, multiplier_blocks=0).on_multiplier_block == frozenset()


def test_multiplications_by_a_few_bits_are_logic():
    b = Builder()
    x, z = b.source(State("x"), WORD), b.source(Input("z"), Fixed(width=4, fraction=0))
    root = b.quantise(b.multiply(x, z), WORD, Rounding.FLOOR, Overflow.SATURATE)
    typed = b.typed({"x": root}, {}, Rounding.FLOOR)
    assert planned(typed, PLAUSIBLE, None, 1).on_multiplier_block == frozenset()


def test_wide_multiplications_count_a_block_for_each_pair_of_limbs():
    b = Builder()
    x = b.source(State("x"), Fixed(width=32, fraction=20))
    product = b.multiply(x, b.source(Input("z"), Fixed(width=32, fraction=20)))
    typed = b.typed({"x": b.quantise(product, WORD, Rounding.FLOOR, Overflow.WRAP)}, {}, Rounding.FLOOR)
    assert operators(typed, PLAUSIBLE, frozenset({product}))[product].blocks == 4
    assert planned(typed, PLAUSIBLE, None, 1, multiplier_blocks=3).on_multiplier_block == frozenset()


@pytest.mark.parametrize(("width", "by_constant", "blocks"), [(18, True, 1), (20, True, 1), (20, False, 2)])
def test_a_product_by_a_constant_does_not_widen_the_multipliers_that_others_share(width, by_constant, blocks):
    b = Builder()
    x = [b.source(State(f"x[{k}]"), WORD) for k in range(4)]
    wide = b.source(State("w"), Fixed(width=width, fraction=8))
    products = [b.multiply(x[k], x[k - 1]) for k in range(4)]
    products.append(b.multiply(wide, b.constant(13_337, 15) if by_constant else x[0]))
    roots = [b.quantise(k, WORD, Rounding.FLOOR, Overflow.WRAP) for k in products]
    typed = b.typed({f"x[{k}]": roots[k] for k in range(4)} | {"w": roots[4]}, {}, Rounding.FLOOR)
    plan = planned(typed, PLAUSIBLE, None, 1, units={"multiply": 2})
    who = plan.sharing.operations["multiply"]
    assert shared_operator(typed, "multiply", who, PLAUSIBLE, 2, frozenset(who)).blocks == blocks
    spared = width > 18 and by_constant
    assert (products[-1] in who) is not spared
    assert (products[-1] in plan.on_multiplier_block) is not spared
    assert not problems(plan, PLAUSIBLE)


@settings(max_examples=30, deadline=None)
@given(typed_graphs(), devices)
def test_two_schedules_of_a_graph_are_equal(typed: TypedGraph, device: Device):
    again = replace(typed, graph=replace(typed.graph))
    assert planned(typed, device, None, 1) == planned(again, device, None, 1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"interval": 0, "channels": 1}, "architecture.interval is 0: a step takes 1 cycle or more"),
        ({"interval": 1, "channels": 0}, "architecture.channels is 0: use 1 track or more"),
        (
            {"interval": 1, "channels": 1, "clock_mhz": float("nan")},
            "architecture.clock_mhz is nan: use a number of MHz above 0",
        ),
        (
            {"interval": 1, "channels": 1, "multiplier_blocks": -1},
            "architecture.multiplier_blocks is -1: use 0 blocks or more",
        ),
    ],
)
def test_an_architecture_that_cannot_be_is_refused(arguments: dict[str, float], message: str):
    with pytest.raises(ScheduleError) as error:
        planned(alpha_beta(), UNIT, **arguments)
    assert str(error.value) == message


@pytest.mark.slow
def test_ten_thousand_operations_are_scheduled_in_under_a_minute():
    import time

    b = Builder()
    values = [b.source(State(f"x[{k}]"), WORD) for k in range(54)]
    while len(b.operations) < 10_000:
        k = len(b.operations)
        total = b.sum(Add, values[-1 - k % 53], values[-1 - k * k % 47])
        values.append(b.quantise(total, WORD, Rounding.FLOOR, Overflow.SATURATE))
    typed = b.typed({f"x[{k}]": values[-1 - k] for k in range(54)}, {}, Rounding.FLOOR)
    begin = time.process_time()
    planned(typed, PLAUSIBLE, 10, 1)
    assert time.process_time() - begin < 60
