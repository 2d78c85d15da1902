"""Loadable coefficients: one build, several models, and what does not fit is refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kalmanhdl.algorithm import ALGORITHMS, LINEAR, Algorithm, Scheduled
from kalmanhdl.algorithm.loadable import UnlikeError, coefficients, moved, trace_loadable, values
from kalmanhdl.algorithm.trace import trace
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.errors import DesignError, FormatError, ModelError, VerificationError
from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.graph.text import parse_graph, print_graph
from kalmanhdl.loading import image_of, verify_image
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import LinearModel, linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import Hardware, compile_design, numbers_of, verify
from kalmanhdl.report.formats import resolutions
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.verify.stimulus import from_model


def turning(rate: float, noise: float = 0.2, speed: float = 0.9) -> LinearModel:
    """Two states that turn into each other and decay, the first one measured."""
    F = speed * np.array([[np.cos(rate), np.sin(rate)], [-np.sin(rate), np.cos(rate)]])
    R = [[1.0 + noise]]
    return linear_model(F, [[1.0, 0.0]], noise * np.eye(2), R, initial=given([0.5, -0.25], np.eye(2)))


def design(units: dict[str, int] | None = None, algorithm: Algorithm | str = "conventional") -> Design:
    return Design(
        name="turning",
        model=turning(0.3),
        algorithm=algorithm,
        numerics=FixedSpecification(width=14),
        architecture=Architecture(units=units, coefficients="loadable"),
        target=Target(device="ecp5-25k"),
    )


@cache
def hardware(shared: bool) -> Hardware:
    return compile_design(design({"multiply": 1, "reciprocal": 1} if shared else None))


OTHER = turning(0.5, 0.17, 0.8)


@pytest.mark.parametrize("kind", sorted(set(LINEAR) - {Scheduled.kind}))
def test_a_filter_with_coefficients_computes_what_the_one_with_numbers_does(kind: str):
    model, algorithm = turning(0.3), ALGORITHMS[kind]()
    found, plain = trace_loadable(model, algorithm), trace(model, algorithm(model))
    random = np.random.default_rng(3)
    leaves = {"z[0]": 0.7, "valid[0]": True, "initialise": False}
    states = dict(found.graph.states)
    leaves |= {name: 0.4 + 0.3 * random.random() for name in states}
    leaves |= {name: 0.1 for name in states if name == "P[0,1]"}
    a, b = evaluate(found.graph, leaves), evaluate(plain, leaves)
    for (name, index), (_, other) in zip(found.graph.outputs, plain.outputs, strict=True):
        assert a[index] == pytest.approx(b[other], rel=1e-9), name


def test_equal_numbers_of_a_model_that_mean_different_things_are_different_coefficients():
    model = turning(0.3)
    assert model.F[0, 0] == model.F[1, 1]
    assert model.Q[0, 0] == model.Q[1, 1]
    graph = trace_loadable(model, ALGORITHMS["conventional"]()).graph
    found = [float(value) for value in values(graph).values()]
    assert found.count(model.F[0, 0]) == 2
    assert found.count(model.Q[0, 0]) == 2


@pytest.mark.parametrize("kind", sorted(set(LINEAR) - {Scheduled.kind}))
def test_numbers_that_are_the_same_for_every_model_are_no_coefficients(kind: str):
    model, algorithm = turning(0.3), ALGORITHMS[kind]()
    found = trace_loadable(model, algorithm)
    other = coefficients(found, moved(model, 99), algorithm)
    assert all(value != other[name] for name, value in values(found.graph).items())


def test_a_graph_with_coefficients_parses_back():
    graph = trace_loadable(turning(0.3), ALGORITHMS["joseph"]()).graph
    assert parse_graph(print_graph(graph)) == graph


def test_gains_in_tables_are_no_coefficients():
    with pytest.raises(UnlikeError):
        trace_loadable(turning(0.3), Scheduled(4))
    with pytest.raises(DesignError, match='"scheduled" keeps numbers of the model in tables'):
        numbers_of(design(algorithm=Scheduled(4)))


@pytest.mark.parametrize("shared", [False, True])
def test_two_models_run_on_one_build(shared: bool):
    built = hardware(shared)
    assert all(found.mismatches == 0 for found in verify(built, 200, optimised=False))
    words = image_of(built.design, OTHER, built.numbers)
    assert all(found.mismatches == 0 for found in verify_image(built, OTHER, words, 200))


def test_a_coefficient_at_a_wrong_address_is_found():
    built = hardware(False)
    first, second, *rest = image_of(built.design, OTHER, built.numbers)
    assert first.raw != second.raw
    with pytest.raises(VerificationError):
        # What is written follows the order, what the engine takes the names.
        verify_image(built, OTHER, (second, first, *rest), 200)


def test_an_image_makes_the_filter_of_the_other_model():
    """The hardware's integers with an image are near the other model's own filter in floats."""
    built = hardware(False)
    words = image_of(built.design, OTHER, built.numbers)
    typed = built.numbers.typed.loaded({word.name: word.raw for word in words})
    own = numbers_of(replace(design(), model=OTHER, architecture=Architecture()))
    steps = from_model(OTHER, typed, 400, 4, 1)
    alone = from_model(OTHER, own.typed, 400, 4, 1)
    a = Engine.of(typed, optimised=False).run(steps.inputs, steps.flags, active=steps.active)
    b = Engine.of(own.typed, optimised=False).run(alone.inputs, alone.flags, active=alone.active)
    for name in ("x[0]", "x[1]"):
        real = [
            trace.outputs[name] * resolutions(graph)[name] for trace, graph in ((a, typed), (b, own.typed))
        ]
        assert np.abs(real[0] - real[1]).max() < 0.02 * np.abs(real[1]).max()


def test_reset_leaves_coefficients():
    # Sections of random steps end by resets, and all were verified with the image of another model.
    built = hardware(False)
    words = image_of(built.design, OTHER, built.numbers)
    assert verify_image(built, OTHER, words, 3000)[1].steps == 1500


@pytest.mark.parametrize(
    ("model", "error", "message"),
    [
        (
            replace(turning(0.3), B=np.ones((2, 1)), control_names=("u",)),
            ModelError,
            r"B is 2 x 1: .* for 2 x 0",
        ),
        (
            replace(turning(0.3), offset=np.array([0.0, 2.0])),
            ModelError,
            r"offset\[1\] is 2, where .* a zero",
        ),
        (
            turning(0.3, noise=20.0),
            FormatError,
            r"c\[\d+\] \(.*\) is .* but fixed\(18, fraction=\d+\) ends at",
        ),
    ],
)
def test_a_model_that_does_not_fit_is_refused(model: LinearModel, error: type[Exception], message: str):
    with pytest.raises(error, match=message):
        image_of(design(), model, hardware(False).numbers)


def test_a_zero_where_the_pattern_has_a_number_is_loaded_as_zero():
    still = replace(turning(0.3), F=np.diag([0.5, 0.5]))
    words = image_of(design(), still, hardware(False).numbers)
    assert sum(word.raw == 0 for word in words) == 2


def test_hardware_with_fixed_numbers_loads_nothing():
    with pytest.raises(DesignError, match='"fixed": nothing can be loaded'):
        image_of(replace(design(), architecture=Architecture()), OTHER)
