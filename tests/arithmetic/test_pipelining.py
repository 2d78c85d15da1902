"""Registers cut a chain of steps so that its longest stage is as short as possible."""

from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.arithmetic.pipelining import longest_stage, register_places

WEIGHTS = st.lists(st.integers(0, 9), min_size=1, max_size=7)


@given(WEIGHTS, st.integers(0, 9))
def test_every_register_has_a_place_after_the_first_step(weights, registers):
    places = register_places(weights, registers)
    assert len(places) == len(weights) + 1
    assert sum(places) == registers
    assert places[0] == 0


@given(WEIGHTS, st.integers(0, 6))
def test_no_other_cuts_make_the_longest_stage_shorter(weights, registers):
    count = min(registers, len(weights) - 1)
    best = min(
        max(sum(weights[a:b]) for a, b in pairwise((0, *cuts, len(weights))))
        for cuts in combinations(range(1, len(weights)), count)
    )
    assert longest_stage(weights, registers) == best


@given(st.lists(st.sampled_from([0.1, 1.0, 1.4]), min_size=1, max_size=7), st.integers(0, 6))
def test_weights_that_are_no_whole_numbers_are_cut_as_well(weights, registers):
    """Sums as the stages are filled: in floating point another order is another number."""
    count = min(registers, len(weights) - 1)
    best = min(
        max(sum(weights[a:b], 0.0) for a, b in pairwise((0, *cuts, len(weights))))
        for cuts in combinations(range(1, len(weights)), count)
    )
    assert longest_stage(weights, registers) == pytest.approx(best, rel=1e-12)


def test_a_chain_of_thousands_of_steps_is_cut():
    """As a division of a thousand bits has them; to try every stage there could be would never end."""
    weights = (0.1, *[1.0, 1.4] * 2000, 1.1)
    assert longest_stage(weights, 4001) == 1.4
    assert sum(register_places(weights, 500)) == 500
