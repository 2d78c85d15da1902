"""What tracing finds without being told about a model."""

import numpy as np
import pytest

from kalmanhdl.algorithm import ALGORITHMS, LINEAR
from kalmanhdl.algorithm.filter import Given, step
from kalmanhdl.algorithm.memory import COUNTER
from kalmanhdl.algorithm.trace import components, trace
from kalmanhdl.design import Design
from kalmanhdl.graph.balance import balanced
from kalmanhdl.graph.builder import reachable
from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.graph.simplify import counts
from kalmanhdl.numerics.integers import numbers
from random_designs import random_design

DESIGNS = "designs/"


def _counts(graph):
    return counts(graph.operations, reachable(graph.operations, [root for _, root in graph.states]))


@pytest.mark.parametrize("kind", ["conventional", "sequential"])
def test_the_radar_filter_needs_eight_multiplications_and_two_reciprocals(kind):
    design = Design.load(DESIGNS + "lee1997.toml")
    graph = numbers(design.model, ALGORITHMS[kind](), design.numerics).graph
    found = _counts(graph)
    assert (found["multiply"], found["reciprocal"], found["divide"]) == (8, 2, 0)
    # In the paper's own units as well, where R is not one.
    unscaled = _counts(trace(design.model, ALGORITHMS[kind]()(design.model)))
    assert (unscaled["multiply"], unscaled["reciprocal"], unscaled["divide"]) == (8, 2, 0)


def test_range_and_bearing_fall_apart():
    design = Design.load(DESIGNS + "lee1997.toml")
    for algorithm in map(ALGORITHMS.get, LINEAR):
        assert components(trace(design.model, algorithm()(design.model))) == (
            ("x[0]", "x[1]"),
            ("x[2]", "x[3]"),
        )


def test_only_the_filled_upper_triangle_is_state():
    design = Design.load(DESIGNS + "lee1997.toml")
    states = [name for name, _ in trace(design.model, ALGORITHMS["conventional"]()(design.model)).states]
    assert states[4:] == ["P[0,0]", "P[0,1]", "P[1,1]", "P[2,2]", "P[2,3]", "P[3,3]"]


def _leaves(graph, random):
    names = [operation.name for operation in graph.operations if hasattr(operation, "name")]
    leaves = {name: random.standard_normal(7) for name in names}
    leaves |= {name: random.random(7) < 0.6 for name in names if name.startswith(("valid", "init"))}
    leaves |= {name: np.round(random.random(7)) for name in names if name.startswith(f"{COUNTER}[")}
    return leaves


def _run(model, filter_, leaves):
    """The algorithm itself on the same numbers, element by element arrays over samples."""
    zero = np.zeros(7)
    memory = {
        kept.name: kept.whole({place: leaves.get(kept.element(place), zero) for place in kept.places()})
        for kept in filter_.kept
    }
    z, u = np.empty(model.m, object), np.empty(model.p, object)
    for j in range(model.m):
        z[j] = leaves.get(f"z[{j}]", zero)
    for k in range(model.p):
        u[k] = leaves.get(f"u[{k}]", zero)
    valid = tuple(leaves[f"valid[{j}]"] for j in range(model.m))
    return step(filter_, memory, Given(z, valid, u, leaves["initialise"]))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(30))
def test_the_graph_computes_what_the_algorithm_does(seed):
    design = random_design(seed, max_states=4)
    model, filter_ = design.model, design.algorithm(design.model)
    plain = trace(model, filter_)
    random = np.random.default_rng(seed)
    leaves = _leaves(plain, random)
    for i in range(model.n):
        # Any covariance will do, as long as S can be inverted safely.
        if f"D[{i}]" in leaves:
            leaves[f"D[{i}]"] = np.abs(leaves[f"D[{i}]"])
        if f"P[{i},{i}]" in leaves:
            leaves[f"P[{i},{i}]"] = 10 * model.n + np.abs(leaves[f"P[{i},{i}]"])
    outcome = _run(model, filter_, leaves)
    for graph in (plain, balanced(plain)):
        values = evaluate(graph, leaves)
        for name, root in (*graph.states, *graph.outputs):
            _close(values[root], _of(outcome, name), name)


def _of(outcome, name):
    if name == "nis":
        return outcome.nis
    base, place = name.rstrip("]").split("[")
    indices = tuple(map(int, place.split(",")))
    arrays = {"P": outcome.belief.P, "innovation": outcome.innovation, **outcome.memory}
    return arrays[base][indices]


def _close(found, expected, name):
    scale = 1 + np.abs(np.broadcast_to(expected, 7)).max()
    np.testing.assert_allclose(
        np.broadcast_to(found, 7), np.broadcast_to(expected, 7), rtol=1e-6, atol=1e-8 * scale, err_msg=name
    )
