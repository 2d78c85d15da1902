"""The compiled engine gives, bit for bit, what the definition gives."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest
from conftest import Builder, radar
from random_graphs import random_graph, random_inputs

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import DataError, FormatError, ToolError
from kalmanhdl.simulate import compiler
from kalmanhdl.simulate.engine import Engine, Trace, engines
from kalmanhdl.simulate.interpreter import interpret


def interpreted(engine: Engine) -> Engine:
    """The same engine as on a machine without a C compiler."""
    return replace(engine, library=None)


def assert_same(one: Trace, other: Trace, active: np.ndarray) -> None:
    for name, values in one.outputs.items():
        assert np.array_equal(values[active], other.outputs[name][active]), name
    for name, values in one.states.items():
        assert np.array_equal(values, other.states[name]), name
        assert np.array_equal(one.final_state[name], other.final_state[name]), name
    assert one.saturations == other.saturations
    assert one.violations == other.violations
    assert one.extremes == other.extremes


def check(seeds: range, minimum_bits: int, operations: int = 14) -> None:
    graphs = [random_graph(Random(seed), operations) for seed in seeds]
    for seed, engine in zip(seeds, engines(graphs, minimum_bits), strict=True):
        inputs, flags, active, state = random_inputs(Random(seed), engine.typed, 9, 5)
        arguments = {"active": active, "initial_state": state, "monitor": True}
        compiled = engine.run(inputs, flags, **arguments)
        try:
            assert_same(compiled, interpreted(engine).run(inputs, flags, **arguments), active)
        except AssertionError as error:
            raise AssertionError(f"random_graph(Random({seed}), {operations})") from error


@pytest.mark.parametrize("minimum_bits", [0, 64, 128, 700])
def test_compiled_and_interpreted_engine_agree_on_random_graphs(minimum_bits):
    check(range(24), minimum_bits)


@pytest.mark.slow
@pytest.mark.parametrize("batch", range(10))
def test_compiled_and_interpreted_engine_agree_on_many_random_graphs(batch):
    check(range(1000 + 100 * batch, 1100 + 100 * batch), 0, 24)
