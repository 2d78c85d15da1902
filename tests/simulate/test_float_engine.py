"""The floating-point engine gives, bit for bit, what its definition gives, and what processors give."""

from dataclasses import replace

import numpy as np
import pytest
from float_graphs import corners, every_operation, raws

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.simulate.engine import Engine, engines

SINGLE, HALF, DOUBLE = Float(8, 23), Float(5, 10), Float(11, 52)
ZERO = Rounding.TOWARD_ZERO
FORMS = (
    SINGLE,
    HALF,
    DOUBLE,
    replace(SINGLE, rounding=ZERO),
    replace(SINGLE, subnormals=False),
    replace(SINGLE, rounding=ZERO, subnormals=False),
    replace(HALF, rounding=ZERO),
    replace(HALF, subnormals=False),
    replace(DOUBLE, rounding=ZERO),
    replace(DOUBLE, subnormals=False),
    Float(8, 7),
    Float(2, 1),
    Float(4, 3, ZERO, subnormals=False),
    Float(9, 24),
    Float(9, 25),
    Float(6, 55, ZERO),
    Float(15, 47),
    Float(10, 20, subnormals=False),
)


def data(form, random, shape):
    inputs = {name: raws(form, random, shape) for name in "abc"}
    flags = {name: random.random(shape) < 0.5 for name in ("flag", "initialise")}
    return inputs, flags


def assert_same(one, other):
    for name, values in one.outputs.items():
        np.testing.assert_array_equal(values, other.outputs[name].astype(values.dtype), name)
    assert one.violations == other.violations


@pytest.fixture(scope="module")
def compiled():
    """The engines of every format, products rounded and fused."""
    keys = [(form, fused) for form in FORMS for fused in (False, True)]
    graphs = [every_operation(form, fused=fused) for form, fused in keys]
    return dict(zip(keys, engines(graphs), strict=True))


@pytest.mark.parametrize("fused", [False, True])
@pytest.mark.parametrize("form", FORMS, ids=lambda form: f"{form} {form.rounding.value} {form.subnormals}")
def test_every_operation_is_as_defined(compiled, form, fused):
    engine = compiled[form, fused]
    assert engine.compiled
    inputs, flags = data(form, np.random.default_rng(1), (25, 20))
    interpreted = replace(engine, library=None)
    assert_same(engine.run(inputs, flags), interpreted.run(inputs, flags))


def test_all_pairs_of_corners_are_as_defined(compiled):
    for form in (SINGLE, replace(SINGLE, rounding=ZERO), replace(DOUBLE, rounding=ZERO)):
        ends = np.array(corners(form), np.uint64)
        a, b = (each.reshape(-1, 1) for each in np.meshgrid(ends, ends))
        inputs = {"a": a, "b": b, "c": a[::-1]}
        flags = dict.fromkeys(("flag", "initialise"), np.ones(a.shape, bool))
        engine = compiled[form, True]
        assert_same(engine.run(inputs, flags), replace(engine, library=None).run(inputs, flags))
