"""What is said to be proven holds, whatever adversaries do; what is said to be reachable is reached."""

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from kalmanhdl.algorithm import ALGORITHMS
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.proof.adversary import attack
from kalmanhdl.proof.prove import BY_PATHS, BY_SEARCH, prove

COAST = 2

BEGUN = given([50, 0], np.diag([100, 4]))


@st.composite
def designs(draw):
    """A model of a slow state and what it moves by, an algorithm and formats, from roomy to too narrow."""
    decay, step = draw(st.floats(0.5, 1.0)), draw(st.floats(0.1, 1.0))
    noise = draw(st.floats(0.05, 2.0))
    two_points = draw(st.booleans())
    model = linear_model(
        [[draw(st.floats(0.8, 1.0)), step], [0, decay]],
        [[1, 0]] if two_points else [[1, draw(st.floats(-0.5, 0.5))]],
        np.diag([0.01 * noise, noise]),
        [[draw(st.floats(0.2, 5.0))]],
        initial=two_point() if two_points else BEGUN,
        measurement_range=[sorted(draw(st.tuples(st.integers(-100, 0), st.integers(1, 100))))],
    )
    coast = draw(st.integers(0, 2))
    state, product = draw(st.integers(8, 18)), draw(st.integers(10, 24))
    numerics = FixedSpecification(
        width=draw(st.integers(5, 8)),
        classes={"state": Fixed(width=state, fraction=state - draw(st.integers(2, 5))), "product": product},
        rounding=draw(st.sampled_from(Rounding)),
        scale=(64.0, 64.0),
        coast=coast,
    )
    kind = draw(st.sampled_from(["scheduled", "conventional", "joseph"]))
    return model, ALGORITHMS[kind](), numerics


def tank(limits=((0, 100),), decay=0.9):
    """A level and its flow, of which the level is measured."""
    return linear_model(
        [[1, 0.5], [0, decay]],
        [[1, 0]],
        np.diag([0.01, 0.5]),
        [[1]],
        initial=BEGUN,
        measurement_range=limits,
    )


ROOMY = FixedSpecification(
    width=12,
    classes={
        "state": Fixed(width=20, fraction=16),
        "innovation": Fixed(width=18, fraction=13),
        "product": 22,
    },
    scale=(128.0, 128.0),
    coast=COAST,
)


@pytest.fixture(scope="module")
def proven():
    model = tank()
    typed = numbers(model, ALGORITHMS["scheduled"](), ROOMY).typed
    return model, typed, prove(model, typed, COAST)


def test_states_with_known_gains_are_bounded_for_every_input(proven):
    _, typed, proof = proven
    assert not any(part.unbounded for part in proof.parts)
    roots = dict(typed.graph.states)
    for name in ("x[0]", "x[1]"):
        assert proof.proven[roots[name]] == BY_PATHS


def test_adversaries_stay_within_the_bounds_and_come_near_them(proven):
    model, typed, proof = proven
    seen = attack(model, typed, proof, steps=2_000, tracks=50, seed=1)
    assert not {k: n for k, n in seen.violations.items() if k in proof.proven and n}
    root = dict(typed.graph.states)["x[0]"]
    bound, reached = proof.bounds[root], seen.extremes[root]
    assert bound.low <= reached.low
    assert reached.high <= bound.high
    assert reached.high - reached.low > 0.6 * (bound.high - bound.low)


def test_covariances_are_all_found_and_none_is_beyond_them():
    model = tank()
    typed = numbers(model, ALGORITHMS["conventional"](), FixedSpecification(width=8, coast=1)).typed
    proof = prove(model, typed, 1)
    (part,) = proof.parts
    assert part.covariances
    by_search = {k for k, how in proof.proven.items() if how == BY_SEARCH}
    assert by_search
    seen = attack(model, typed, proof, steps=1_000, tracks=50, seed=2)
    assert not any(seen.violations[k] for k in proof.proven)
    for index in by_search:
        bound, reached = proof.bounds[index], seen.extremes[index]
        assert bound.low <= reached.low
        assert reached.high <= bound.high


def test_nothing_is_proven_of_states_that_inputs_can_drive_out_of_their_formats():
    model = tank(decay=1.0)
    narrow = FixedSpecification(width=10, coast=1)
    typed = numbers(model, ALGORITHMS["scheduled"](), narrow).typed
    proof = prove(model, typed, 1)
    assert any(part.unbounded for part in proof.parts)
    seen = attack(model, typed, proof, steps=500, tracks=50, seed=3)
    beyond = {k for k, count in seen.violations.items() if count}
    assert beyond
    assert not beyond & set(proof.proven)


@settings(max_examples=12, deadline=None)
@drawn(designs(), st.integers(0, 2**32))
def test_no_adversary_leaves_what_is_proven(design, seed):
    model, algorithm, numerics = design
    typed = numbers(model, algorithm, numerics).typed
    proof = prove(model, typed, numerics.coast)
    seen = attack(model, typed, proof, steps=300, tracks=24, seed=seed)
    assert not [k for k in proof.proven if seen.violations[k]]
    if set(proof.proven) == set(seen.violations):
        for index, bound in proof.bounds.items():
            if index in seen.extremes:
                assert bound.low <= seen.extremes[index].low
                assert seen.extremes[index].high <= bound.high
