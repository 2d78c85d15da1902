"""What a design may ask of floating point, and the graph that it gets."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl import FixedSpecification
from kalmanhdl.algorithm import ALGORITHMS, Conventional
from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.design import Design
from kalmanhdl.design_file import dumps, loads
from kalmanhdl.errors import DesignError, FormatError
from kalmanhdl.graph.operations import Add, Constant, Function, Graph, Input, Multiply, Subtract, Unary
from kalmanhdl.numerics.floating import FloatSpecification, float_numbers, floated

ROOT = Path(__file__).parents[2]
LEE = Design.load(ROOT / "designs" / "lee1997.toml")
SINGLE = FloatSpecification(exponent=8, mantissa=23)
TEXT = (ROOT / "designs" / "lee1997.toml").read_text().partition("[numerics]")[0] + "[numerics]\n"


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ('kind = "float"\nformat = "single"', SINGLE),
        ('kind = "float"\nformat = "half"', FloatSpecification(exponent=5, mantissa=10)),
        (
            'kind = "float"\nformat = "double"\nfused = true',
            FloatSpecification(exponent=11, mantissa=52, fused=True),
        ),
        (
            'kind = "float"\nexponent = 6\nmantissa = 9\nrounding = "toward_zero"\nsubnormals = false',
            FloatSpecification(exponent=6, mantissa=9, rounding=Rounding.TOWARD_ZERO, subnormals=False),
        ),
    ],
)  # fmt: skip
def test_a_design_file_says_it(lines, expected):
    design = loads(TEXT + lines)
    assert design.numerics == expected
    assert loads(dumps(design)).numerics == expected


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("", 'exponent is missing: write it, or format = "half" or "single" or "double"'),
        ("exponent = 8", "mantissa is missing"),
        ('format = "quad"', r"line 32: \[numerics\] format = 'quad' is unknown: valid are half, single"),
        ('format = "single"\nmantissa = 4', "format = 'single' has its exponent and mantissa: leave them"),
        ("exponent = 1\nmantissa = 4", r"line 32: \[numerics\] exponent = 1: an integer from 2 to 19"),
        ("exponent = 8\nmantissa = 0", "mantissa = 0: an integer from 1 to 236"),
        ('format = "half"\nrounding = "floor"', "rounding = 'floor': one of half_even, toward_zero"),
        ('format = "half"\nwidth = 16', "width is an unknown key"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_its_name(lines, message):
    with pytest.raises(DesignError, match=message):
        loads(TEXT + 'kind = "float"\n' + lines)


def test_word_lengths_are_of_fixed_point():
    with pytest.raises(
        DesignError, match=r'\[numerics\] kind = "float": word lengths and consistency are for fixed point'
    ):
        _ = replace(LEE, numerics=SINGLE).fixed_point
    assert isinstance(LEE.fixed_point, FixedSpecification)


@pytest.mark.parametrize("kind", ["conventional", "joseph", "bierman_thornton"])
def test_the_units_are_the_models(kind):
    numbers = float_numbers(LEE.model, ALGORITHMS[kind](), SINGLE)
    assert set(numbers.typed.scales.values()) == {1.0}
    names = {name for name, _ in (*numbers.typed.graph.states, *numbers.typed.graph.outputs)}
    assert names - {"saturated"} <= set(numbers.typed.scales)


def test_constants_are_numbers_of_the_format():
    typed = float_numbers(LEE.model, Conventional(), SINGLE).typed
    values = [float(o.value) for o in typed.graph.operations if isinstance(o, Constant)]
    assert np.float32(1.3e-8) in values
    assert all(np.float32(value) == value for value in values)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (Fraction(10**6), r"x\[0\]: the constant 1e\+06 is no number of float\(5, 10\), which ends at 65504"),
        (Fraction(1, 10**9), r"output: x\[0\]: the constant 1e-09 .* begins at 5.96046e-08: use more bits"),
    ],
)  # fmt: skip
def test_a_constant_out_of_reach_is_refused(value, message):
    operations = (Constant(value), Input("z[0]"), Multiply(0, 1))
    graph = Graph(operations, ("", "z[0]", "output: x[0]"), (), (("x[0]", 2),))
    with pytest.raises(FormatError, match=message):
        floated(graph, FloatSpecification(exponent=5, mantissa=10), {})


def test_functions_become_operations_of_the_format():
    graph = Graph((Input("z[0]"), Unary(Function.SINE, 0)), ("z[0]", "predict: x[0]"), (), (("x[0]", 1),))
    typed = floated(graph, FloatSpecification(exponent=15, mantissa=112), {})
    functions = {o.function for o in typed.graph.operations if isinstance(o, Unary)}
    assert functions == {Function.WRAP}
    assert typed.graph.origins[dict(typed.graph.outputs)["x[0]"]] == "predict: x[0]"
    # A finite argument has a finite sine: nothing inside of it is watched.
    assert {v.value for v in typed.violations} == {0, dict(typed.graph.outputs)["x[0]"]}


def test_a_product_of_one_sum_alone_is_fused():
    products = (Multiply(0, 1), Multiply(0, 0), Add(2, 3), Multiply(1, 1), Add(4, 5), Subtract(6, 5))
    operations = (Input("a"), Input("b"), *products)
    graph = Graph(operations, ("t",) * len(operations), (), (("x", 7),))
    assert floated(graph, replace(SINGLE, fused=True), {}).fused == {2}
    assert floated(graph, SINGLE, {}).fused == set()
