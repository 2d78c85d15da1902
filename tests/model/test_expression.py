"""Numbers written as expressions."""

import contextlib
import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.errors import DesignError
from kalmanhdl.model.expression import evaluate, resolve

CONSTANTS = {"T": 15.0, "sigma": 0.017}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e6", 1e6),
        (".5", 0.5),
        ("2.", 2.0),
        ("pi/90", math.pi / 90),
        ("T^2/2", 112.5),
        ("sqrt(2)*sigma", math.sqrt(2) * 0.017),
        ("-T^2", -225.0),
        ("2^-1", 0.5),
        ("2**3**2", 512.0),
        ("-2 - -3", 1.0),
        ("8/4/2", 1.0),
        ("8 - 4 - 2", 2.0),
        ("(1 + 2) * 3", 9.0),
        ("atan2(1, -1)", 3 * math.pi / 4),
        ("hypot(3, 4) + exp(0) + log(e) + cos(0) + sin(0) + tan(0)", 8.0),
        ("  T  ", 15.0),
    ],
)
def test_an_expression_has_its_usual_value(text, value):
    assert evaluate(text, CONSTANTS) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "ends too early"),
        ("1 +", "ends too early"),
        ("(1", "')' is missing"),
        ("1)", "is not expected here"),
        ("2 T", "'T' is not expected here"),
        ("sigm", "did you mean 'sigma'?"),
        ("sqr(2)", "did you mean 'sqrt'?"),
        ("sqrt", "needs its argument in parentheses"),
        ("T(2)", "the function 'T' is unknown"),
        ("hypot(3)", "hypot takes 2 arguments, not 1"),
        ("sqrt(-1)", "has no real value"),
        ("(-8)^(1/3)", "has no real value"),
        ("1/0", "has no real value"),
        ("log(0)", "has no real value"),
        ("9^9^9^9", "is too large for a number"),
        ("1e999", "is too large for a number"),
        ("1e308*10 - 1e308*10", "is too large for a number"),
        ("1" * 201, "201 characters: an expression has at most 200"),
        ("(" * 60 + "1" + ")" * 60, "nested deeper than 32"),
        ("-" * 60 + "1", "nested deeper than 32"),
        ("__import__('os')", "belongs to no expression"),
        ("T.real", "belongs to no expression"),
        ("[1]", "belongs to no expression"),
        ("1_000", "'_000' is not expected here"),
        ("1 if T else 2", "is not expected here"),
    ],
)
def test_anything_else_is_refused_with_its_reason(text, message):
    with pytest.raises(DesignError) as caught:
        evaluate(text, CONSTANTS)
    assert message in str(caught.value)


def test_constants_refer_to_each_other_in_any_order():
    assert resolve({"a": "b^2", "b": "c + 1", "c": 2.0}) == {"a": 9.0, "b": 3.0, "c": 2.0}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"a": "b", "b": "c", "c": "a"}, "in a cycle: a -> b -> c -> a"),
        ({"a": "a"}, "in a cycle: a -> a"),
        ({"a": "bb", "b": 1.0}, "the name 'bb' is unknown"),
        ({f"c{i}": f"c{i + 1}" for i in range(100)}, "in a chain"),
        ({f"c{i}": 1.0 for i in range(300)}, "at most 256"),
    ],
)
def test_constants_that_cannot_be_resolved_are_refused(table, message):
    with pytest.raises(DesignError) as caught:
        resolve(table)
    assert message in str(caught.value)


@given(st.text(alphabet="0123456789.e+-*/^(), Tpisqrtlog", max_size=220))
def test_any_text_gives_a_finite_number_or_one_message_at_once(text):
    start = time.process_time()
    with contextlib.suppress(DesignError):
        assert math.isfinite(evaluate(text, CONSTANTS))
    assert time.process_time() - start < 0.5


_numbers = st.floats(0.1, 10).map(lambda x: (repr(x), x))


def _joined(parts):
    (left, a), sign, (right, b) = parts
    value = {"+": a + b, "-": a - b, "*": a * b, "/": a / b if b else math.nan}[sign]
    return f"({left}{sign}{right})", value


@given(st.recursive(_numbers, lambda e: st.tuples(e, st.sampled_from("+-*/"), e).map(_joined), max_leaves=6))
def test_nested_arithmetic_follows_ieee_754(case):
    text, value = case
    if len(text) <= 200 and math.isfinite(value):
        assert evaluate(text, {}) == value
