"""Registers cut a chain of steps so that its longest stage is as short as possible."""

from itertools import combinations, pairwise

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
