"""Functions beyond arithmetic: the compiled engine and its definition in Python."""

from dataclasses import replace

import numpy as np
import pytest

from function_graphs import Robot
from kalmanhdl.numerics.functions.method import Cordic, Interpolation
from kalmanhdl.numerics.text import parse_typed_graph, print_typed_graph
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.interpreter import interpret


@pytest.mark.parametrize("method", [Cordic(), Interpolation(index_bits=4)])
@pytest.mark.parametrize("width", [8, 16, 24, pytest.param(36, marks=pytest.mark.slow)])
def test_compiled_and_interpreted_functions_agree(width, method):
    typed = Robot(width, method).typed
    engine, random = Engine.of(typed), np.random.default_rng(width)
    limit = 1 << (width - 1)
    inputs = {f"z[{k}]": random.integers(-limit, limit, (12, 8)) for k in range(2)}
    inputs["z[1]"][:, ::2] >>= width // 2
    flags = {"initialise": np.arange(12)[:, None] % 7 < np.ones(8, int)}
    compiled = engine.run(inputs, flags)
    slow = replace(engine, library=None).run(inputs, flags)
    for name, values in compiled.outputs.items():
        assert np.array_equal(values, slow.outputs[name]), name
    for name, values in compiled.states.items():
        assert np.array_equal(values, slow.states[name]), name
    assert compiled.violations == slow.violations


@pytest.mark.parametrize("method", [Cordic(), Interpolation(index_bits=5)])
@pytest.mark.parametrize("width", [6, 12, 16, 24])
def test_every_number_stays_within_what_is_known_of_it(width, method):
    typed, random = Robot(width, method).typed, np.random.default_rng(width)
    names = ("z[0]", "z[1]", "x[0]", "x[1]", "x[2]")
    forms = {
        operation.name: form
        for operation, form in zip(typed.graph.operations, typed.formats, strict=True)
        if getattr(operation, "name", "") in names
    }
    for step in range(300):
        given = {}
        for name, form in forms.items():
            anywhere = int(random.integers(form.lowest, form.highest, endpoint=True))
            near = anywhere >> int(random.integers(0, width))
            given[name] = int(random.choice([form.lowest, form.highest, 0, 1, near, anywhere]))
        given |= {"initialise": step % 2, "saturated": 0}
        values = interpret(typed, given, {}).values
        for index, (value, interval) in enumerate(zip(values, typed.intervals, strict=True)):
            assert interval is None or interval.low <= value <= interval.high, (index, given)


def test_a_typed_graph_with_tables_parses_back():
    typed = Robot(16, Interpolation(index_bits=5)).typed
    assert parse_typed_graph(print_typed_graph(typed)) == typed
