"""Formulas from strings, SymPy and Python say the same, and their derivatives are those of the functions."""

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from kalmanhdl import math as elementwise
from kalmanhdl.errors import ModelError
from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.graph.operations import Input
from kalmanhdl.graph.signal import Signal
from kalmanhdl.model.formulas import formulas
from kalmanhdl.model.written import written
from random_formulas import random_formula

NAMES = {"x": ["a", "b", "c"], "u": ["v"]}
SEEDS = st.integers(0, 2**32 - 1)


def made(given_as, count=1, constants=None):
    return formulas("f", given_as, count, NAMES, constants or {})


def point(seed):
    random = np.random.default_rng(seed)
    return random.uniform(0.5, 2.0, 3), random.uniform(0.5, 2.0, 1)


def drawn(seed, count=2):
    random = np.random.default_rng(seed)
    return [random_formula(random, ["a", "b", "c", "v"]) for _ in range(count)]


def values(found, x, u):
    return found(x=x.astype(object), u=u.astype(object)).astype(float)


@given(seed=SEEDS)
@settings(max_examples=150, deadline=None)
def test_derivatives_are_those_of_finite_differences(seed):
    f, (x, u) = made(drawn(seed), 2), point(seed)
    slope = values(f.jacobian("x", 3), x, u)
    step = 1e-5
    for i in range(3):
        move = step * np.eye(3)[i]
        # The five-point formula: its error is of the fourth order.
        near = values(f, x + move, u) - values(f, x - move, u)
        far = values(f, x + 2 * move, u) - values(f, x - 2 * move, u)
        np.testing.assert_allclose(slope[:, i], (8 * near - far) / (12 * step), rtol=1e-6, atol=1e-8)


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_derivatives_are_those_of_sympy(seed):
    (text,), (x, u) = drawn(seed, 1), point(seed)
    symbols = sympy.symbols("a b c v", real=True)
    functions = {
        "hypot": lambda p, q: sympy.sqrt(p**2 + q**2),
        # Never beyond half a turn in these formulas.
        "wrap": lambda p: p,
    }
    known = dict(zip("abcv", symbols, strict=True))
    expression = sympy.sympify(text.replace("^", "**"), locals={**known, **functions})
    slope = values(made([text]).jacobian("x", 3), x, u)[0]
    numbers = dict(zip(symbols, (*x, *u), strict=True))
    exact = [float(expression.diff(symbol).evalf(30, subs=numbers)) for symbol in symbols[:3]]
    np.testing.assert_allclose(slope, exact, rtol=1e-11, atol=1e-13)


@given(seed=SEEDS)
@settings(max_examples=60, deadline=None)
def test_what_is_written_reads_back_to_the_same(seed):
    f, (x, u) = made(drawn(seed), 2), point(seed)
    text = written(f, NAMES)
    again = made(text, 2)
    np.testing.assert_allclose(values(again, x, u), values(f, x, u), rtol=1e-13, atol=1e-15)
    assert len(again.graph.operations) <= len(f.graph.operations)


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_on_signals_the_graph_is_the_function(seed):
    f, random = made(drawn(seed), 2).jacobian("x", 3), np.random.default_rng(seed)
    leaves = {f"x[{i}]": random.uniform(0.5, 2.0, 5) for i in range(3)} | {
        "u[0]": random.uniform(0.5, 2.0, 5)
    }
    builder = Builder()
    signals = {name: Signal(builder, builder.intern(Input(name))) for name in leaves}

    def vectors(of):
        x, u = np.empty(3, object), np.empty(1, object)
        x[:], u[0] = [of[f"x[{i}]"] for i in range(3)], of["u[0]"]
        return {"x": x, "u": u}

    traced, direct = f(**vectors(signals)), f(**vectors(leaves))
    for place in np.ndindex(2, 3):
        entry = traced[place]
        if isinstance(entry, Signal):
            found = evaluate(builder.graph([], [("found", entry.index)]), leaves)[-1]
        else:
            found = entry
        np.testing.assert_allclose(
            np.broadcast_to(found, 5), np.broadcast_to(direct[place], 5), rtol=1e-10, atol=1e-12
        )


def test_strings_sympy_and_python_say_the_same():
    a, b, _, v = sympy.symbols("a b c v")
    texts = ["a + T*v*cos(b)", "sqrt(a^2 + 1)", "atan2(b, a)/3", "exp(-a)*tan(b)", "a^-2", "a^1.5"]
    symbols = [
        a + sympy.Float(0.1) * v * sympy.cos(b),
        sympy.sqrt(a**2 + 1),
        sympy.atan2(b, a) / 3,
        sympy.exp(-a) * sympy.tan(b),
        a**-2,
        a ** sympy.Rational(3, 2),
    ]

    def python(x, u):
        a, b, _ = x
        return [
            a + 0.1 * u[0] * elementwise.cos(b),
            elementwise.sqrt(a**2 + 1),
            elementwise.atan2(b, a) / 3,
            elementwise.exp(-a) * elementwise.sin(b) / elementwise.cos(b),
            a**-2,
            a * elementwise.sqrt(a),
        ]

    x, u = point(3)
    found = [values(made(each, 6, {"T": 0.1}), x, u) for each in (texts, symbols, python)]
    exact = [
        x[0] + 0.1 * u[0] * np.cos(x[1]),
        np.sqrt(x[0] ** 2 + 1),
        np.arctan2(x[1], x[0]) / 3,
        np.exp(-x[0]) * np.tan(x[1]),
        x[0] ** -2,
        x[0] ** 1.5,
    ]
    for each in found:
        np.testing.assert_allclose(each, exact, rtol=1e-14)


def test_range_and_bearing_share_a_distance_and_its_reciprocal():
    f = made(["hypot(a, b)", "atan2(a, b)"], 2).jacobian("x", 3)
    words = [type(operation).__name__ for operation in f.graph.operations]
    assert (words.count("Binary"), words.count("Reciprocal"), words.count("Divide")) == (1, 1, 0)
    assert words.count("Multiply") == 4


def test_dependence_is_that_of_the_formulas():
    f = made(["a*v", "c - c + b"], 2)
    np.testing.assert_array_equal(f.dependence("x", 3), [[True, False, False], [False, True, False]])
    np.testing.assert_array_equal(f.dependence("u", 1), [[True], [False]])


@pytest.mark.parametrize(
    ("given_as", "message"),
    [
        (["a + q"], r"f\[0\]: the name 'q' is unknown"),
        (["a + "], r"f\[0\]: ends too early"),
        (["log(a)"], r"f\[0\]: log takes numbers only"),
        (["a^b"], r"f\[0\]: the power of a variable is a small number"),
        (["a^0.3"], r"f\[0\]: the power of a variable is a small number"),
        (["a/0"], r"has no real value"),
        (["__import__('os')"], r"belongs to no expression"),
        (["a.real"], r"belongs to no expression"),
        (["a", "b"], r"f has 2 formulas: write 1"),
        ("a", r"f = 'a' is no list"),
        (5, r"f = 5 is no list"),
        ([None], r"f\[0\] = None is no formula"),
        ([sympy.Symbol("a") > 1], r"is no formula"),
        ([sympy.gamma(sympy.Symbol("a"))], r"is no formula"),
        (lambda x, u: [np.sin(x[0])], r"f: the function fails on symbols"),
        (lambda x, u: [x[0] if x[0] > 0 else 0.0], r"f: the function fails on symbols"),
        (lambda x: [x[0]], r"f: the function fails on symbols"),
        (lambda x, u: [x[5]], r"f: the function fails on symbols"),
        (lambda x, u: ["a"], r"f\[0\] = 'a' is neither a number"),
        (lambda x, u: [float("nan")], r"f\[0\] = nan is not finite"),
        (["+".join(["a"] * 20_000)], r"an expression has at most"),
    ],
)
def test_what_is_no_formula_is_refused_in_one_message(given_as, message):
    with pytest.raises(ModelError, match=message):
        made(given_as)
