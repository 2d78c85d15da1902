"""What is said to be proven holds, whatever adversaries do; what is said to be reachable is reached."""

import numpy as np
import pytest

from kalmanhdl.algorithm import ALGORITHMS
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.proof.adversary import attack
from kalmanhdl.proof.prove import BY_PATHS, BY_SEARCH, prove

COAST = 2


def tank(limits=((0, 100),), decay=0.9):
    """A level and its flow, of which the level is measured."""
    return linear_model(
        [[1, 0.5], [0, decay]],
        [[1, 0]],
        np.diag([0.01, 0.5]),
        [[1]],
        initial=given([50, 0], np.diag([100, 4])),
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
