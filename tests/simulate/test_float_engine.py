"""The floating-point engine gives, bit for bit, what its definition gives, and what processors give."""

import ctypes
import ctypes.util
import platform
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from float_graphs import corners, every_function, every_operation, raws

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


def test_functions_are_as_defined():
    """Those that are made of other operations, in formats of each kind that the C has."""
    forms = (SINGLE, replace(HALF, subnormals=False), replace(DOUBLE, rounding=ZERO), Float(3, 4))
    for form, engine in zip(forms, engines([every_function(form) for form in forms]), strict=True):
        inputs = {name: raws(form, np.random.default_rng(8), (4, 20)) for name in "ab"}
        assert_same(engine.run(inputs, {}), replace(engine, library=None).run(inputs, {}))


def test_all_pairs_of_corners_are_as_defined(compiled):
    for form in (SINGLE, replace(SINGLE, rounding=ZERO), replace(DOUBLE, rounding=ZERO)):
        ends = np.array(corners(form), np.uint64)
        a, b = (each.reshape(-1, 1) for each in np.meshgrid(ends, ends))
        inputs = {"a": a, "b": b, "c": a[::-1]}
        flags = dict.fromkeys(("flag", "initialise"), np.ones(a.shape, bool))
        engine = compiled[form, True]
        assert_same(engine.run(inputs, flags), replace(engine, library=None).run(inputs, flags))


NUMPY = {HALF: (np.float16, np.uint16), SINGLE: (np.float32, np.uint32), DOUBLE: (np.float64, np.uint64)}


@pytest.mark.parametrize("form", NUMPY, ids=str)
def test_arithmetic_equals_numpys(compiled, form):
    inputs, flags = data(form, np.random.default_rng(2), (100, 2000))
    found = compiled[form, False].run(inputs, flags).outputs
    number, integer = NUMPY[form]
    a, b, c = (inputs[name].astype(integer).view(number) for name in "abc")
    with np.errstate(all="ignore"):
        expected = {
            "add": a + b,
            "subtract": a - b,
            "multiply": a * b,
            "divide": a / b,
            "reciprocal": number(1) / a,
            "square_root": np.sqrt(a),
            "product and sum": b * a + c,
            "product less": a * c - b,
            "less product": a - c * b,
            "shift -13": a * number(2.0**-13),
            "shift 9": a * number(2.0**9),
            "select": np.where(flags["flag"], a, b),
        }
        is_negative = a < 0
    for name, values in expected.items():
        expected_raws = np.where(np.isnan(values), integer(form.nan), values.view(integer))
        np.testing.assert_array_equal(found[name], expected_raws, name)
    np.testing.assert_array_equal(found["negative"], is_negative)


def test_fused_operations_equal_wider_ones(compiled):
    """The product of two singles is a double; where its sum with a third is one too, rounding it is exact."""
    inputs, flags = data(SINGLE, np.random.default_rng(3), (100, 2000))
    found = compiled[SINGLE, True].run(inputs, flags).outputs["product and sum"]
    with np.errstate(all="ignore"):
        a, b, c = (inputs[name].astype(np.uint32).view(np.float32).astype(np.float64) for name in "abc")
        product, total = a * b, a * b + c
        part = total - product
        is_exact = (product - (total - part)) + (c - part) == 0
        expected = total.astype(np.float32).view(np.uint32)
    assert is_exact.sum() > 20_000
    np.testing.assert_array_equal(found[is_exact], expected[is_exact])


@pytest.mark.slow
@pytest.mark.parametrize("form", [SINGLE, DOUBLE], ids=str)
def test_operations_rounded_toward_zero_are_as_defined_on_many_numbers(compiled, form):
    engine = compiled[replace(form, rounding=ZERO), True]
    inputs, flags = data(form, np.random.default_rng(4), (1000, 100))
    assert_same(engine.run(inputs, flags), replace(engine, library=None).run(inputs, flags))


def random_form(random):
    width = random.choice([random.randint(4, 20), random.randint(21, 64)])
    exponent = random.randint(2, min(width - 2, 17))
    mantissa = min(width - exponent - 1, 58)
    return Float(exponent, mantissa, random.choice([Rounding.HALF_EVEN, ZERO]), random.random() < 0.6)


def test_formats_of_any_size_are_as_defined():
    random = Random(6)
    forms = [random_form(random) for _ in range(24)]
    graphs = [every_operation(form, fused=random.random() < 0.5) for form in forms]
    for form, engine in zip(forms, engines(graphs), strict=True):
        inputs, flags = data(form, np.random.default_rng(7), (4, 40))
        compiled, interpreted = engine.run(inputs, flags), replace(engine, library=None).run(inputs, flags)
        try:
            assert_same(compiled, interpreted)
        except AssertionError as error:
            raise AssertionError(f"{form!r}, fused {engine.typed.fused}") from error


def test_numbers_wider_than_the_c_has_are_interpreted():
    engine = Engine.of(every_operation(Float(15, 112)))
    assert not engine.compiled
    inputs = {name: np.full((1, 1), engine.typed.form.nearest(value), object) for name, value in
              (("a", 3.0), ("b", 7.0), ("c", 1.0))}  # fmt: skip
    flags = dict.fromkeys(("flag", "initialise"), np.ones((1, 1), bool))
    found = engine.run(inputs, flags).outputs["divide"]
    assert found[0, 0] == engine.typed.form.nearest(Fraction(3, 7))


def test_tracks_do_not_mix(compiled):
    inputs, flags = data(SINGLE, np.random.default_rng(8), (3, 301))
    whole = compiled[SINGLE, False].run(inputs, flags)
    for track in (0, 127, 128, 300):
        alone = [{k: v[:, track : track + 1] for k, v in each.items()} for each in (inputs, flags)]
        for name, values in compiled[SINGLE, False].run(*alone).outputs.items():
            np.testing.assert_array_equal(values[:, 0], whole.outputs[name][:, track])


def test_the_surroundings_do_not_change_results(compiled):
    """Libraries made for speed leave subnormals switched off in the processor."""
    inputs, flags = data(SINGLE, np.random.default_rng(9), (10, 32))
    run = compiled[SINGLE, False].run
    before = run(inputs, flags)
    with fast_arithmetic():
        during = run(inputs, flags)
    assert_same(before, during)


@contextmanager
def fast_arithmetic():
    """Rounding toward zero, as far as C's own library can set it."""
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    toward_zero = 0xC00 if platform.machine() == "x86_64" else 0xC00000
    assert library.fesetround(toward_zero) == 0
    try:
        yield
    finally:
        library.fesetround(0)
