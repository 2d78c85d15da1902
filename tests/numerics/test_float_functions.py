"""Functions made of floating-point operations, against 40 digits: how many last bits they are off."""

import mpmath
import numpy as np
import pytest

from function_graphs import exact
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import Binary, Function, Graph, Input, Unary
from kalmanhdl.numerics.floating import FloatSpecification, floated
from kalmanhdl.simulate.engine import Engine

FORMS = (Float(5, 10), Float(8, 23), Float(11, 52))
# In units of the last bit; a half of one is what any rounding may cost.
BOUNDS = {
    Function.SINE: 2.0,
    Function.COSINE: 2.0,
    Function.EXPONENTIAL: 1.25,
    Function.ARCTANGENT: 3.0,
    Function.HYPOTENUSE: 2.0,
    Function.WRAP: 0.0,
}


def values(form, function, *raws):
    """The raw results of a function."""
    count = len(raws)
    operation = Unary(function, 0) if count == 1 else Binary(function, 0, 1)
    operations = (*map(Input, "ab"[:count]), operation)
    graph = Graph(operations, ("test: x",) * len(operations), (), (("f", count),))
    typed = floated(graph, FloatSpecification(exponent=form.exponent, mantissa=form.mantissa), {})
    inputs = {name: np.asarray(raw)[None, :] for name, raw in zip("ab", raws, strict=False)}
    return Engine.of(typed, optimised=False).run(inputs, {}).outputs["f"][0]


def raws(form, reals):
    return np.array([form.nearest(float(real)) for real in reals], np.uint64)


def last_bits(form, function, found, *arguments):
    """The greatest error in units of the last bit of the exact value."""
    worst = 0.0
    for raw, *given in zip(found.tolist(), *(each.tolist() for each in arguments), strict=True):
        with mpmath.workdps(40):
            wanted = exact(function, *(form.real(int(a)) for a in given))
            real = form.real(int(raw))
            exponent = int(mpmath.floor(mpmath.log(abs(wanted), 2))) if wanted else -form.bias
            unit = mpmath.mpf(2) ** (max(exponent, 1 - form.bias) - form.mantissa)
            worst = max(worst, float(abs(mpmath.mpf(real.numerator) / real.denominator - wanted) / unit))
    return worst


def drawn(form, function, seed):
    """Arguments over the range where the result is a number of the format."""
    random = np.random.default_rng(seed)
    if function is Function.EXPONENTIAL:
        end = {5: 9.0, 8: 85.0, 11: 700.0}[form.exponent]
        return (raws(form, random.uniform(-end, end, 400) * random.choice([1.0, 0.01], 400)),)
    count = 2 if function in (Function.ARCTANGENT, Function.HYPOTENUSE) else 1
    spread = (random.uniform(-3, 3, 400) * 2.0 ** random.integers(-8, 6, 400) for _ in range(count))
    return tuple(raws(form, each) for each in spread)


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("function", BOUNDS, ids=lambda function: function.value)
def test_the_last_bits_that_functions_are_off(function, form):
    arguments = drawn(form, function, 1)
    found = values(form, function, *arguments)
    assert last_bits(form, function, found, *arguments) <= BOUNDS[function]


def test_quarters_of_a_turn_are_exact():
    form = Float(8, 23)
    turns = [whole + quarter / 4 for whole in (-3, 0, 5) for quarter in range(4)]
    for function, expected in ((Function.SINE, (0, 1, 0, -1)), (Function.COSINE, (1, 0, -1, 0))):
        found = values(form, function, raws(form, turns))
        assert [form.double(int(raw)) for raw in found] == [*expected] * 3


def test_the_ends_of_the_numbers():
    form = Float(8, 23)
    nan, top = form.nan, form.infinity

    def one(function, *given):
        return int(values(form, function, *(np.array([form.nearest(each)]) for each in given))[0])

    assert one(Function.EXPONENTIAL, float("inf")) == one(Function.EXPONENTIAL, 200.0) == top
    assert one(Function.EXPONENTIAL, float("-inf")) == one(Function.EXPONENTIAL, -200.0) == 0
    assert form.real(one(Function.EXPONENTIAL, -100.0)) == pytest.approx(np.exp(-100.0), rel=1e-2)
    assert one(Function.ARCTANGENT, 0.0, 0.0) == one(Function.HYPOTENUSE, 0.0, 0.0) == 0
    assert form.real(one(Function.ARCTANGENT, 0.0, -1.0)) == 0.5
    assert form.double(one(Function.HYPOTENUSE, 3e37, 4e37)) == pytest.approx(5e37, rel=1e-6)
    for function in (Function.SINE, Function.COSINE, Function.WRAP, Function.EXPONENTIAL):
        assert one(function, float("nan")) == nan
    for function in (Function.SINE, Function.COSINE, Function.WRAP):
        assert one(function, float("inf")) == nan
