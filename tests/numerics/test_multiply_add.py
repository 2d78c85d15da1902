"""Sums of products give what the sums, products and quantisations gave that they are made of."""

import random
from fractions import Fraction

from hypothesis import given, settings
from hypothesis import strategies as st

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.graph.operations import (
    Add,
    Constant,
    Flag,
    Input,
    Multiply,
    Outside,
    Quantise,
    State,
    StateFlag,
    SumOfProducts,
    SumOutside,
    operands,
)
from kalmanhdl.numerics.multiply_add import with_sums_of_products
from kalmanhdl.numerics.text import parse_typed_graph, print_typed_graph
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.simulate.interpreter import interpret, next_state
from schedule.graphs import Builder, typed_graphs

WORD = Fixed(width=16, fraction=12)


def drawn(typed: TypedGraph, generator: random.Random) -> tuple[dict[str, int], dict[str, int]]:
    """Inputs and states of a step: ends and values between."""
    given_, state = dict[str, int](), dict[str, int]()
    for operation, interval in zip(typed.graph.operations, typed.intervals, strict=True):
        match operation:
            case Flag(name):
                given_[name] = generator.randint(0, 1)
            case StateFlag(name):
                state[name] = generator.randint(0, 1)
            case Input(name) | State(name):
                ends = interval.low, interval.high
                value = generator.choice((*ends, generator.randint(*ends)))
                (state if isinstance(operation, State) else given_)[name] = value
    return given_, state


def equal(typed: TypedGraph, other: TypedGraph, generator: random.Random) -> None:
    for _ in range(5):
        given_, state = drawn(typed, generator)
        one, two = interpret(typed, given_, state), interpret(other, given_, state)
        assert next_state(typed, one.values) == next_state(other, two.values)
        for (name, a), (also, b) in zip(typed.graph.outputs, other.graph.outputs, strict=True):
            assert (name, one.values[a]) == (also, two.values[b])
        for a, b in zip(typed.violations, other.violations, strict=True):
            assert one.values[a.quantise] == two.values[b.quantise]
            assert one.values[a.outside] == two.values[b.outside]


@settings(max_examples=300, deadline=None)
@given(typed_graphs(40), st.integers(6, 20), st.integers(0, 1 << 32))
def test_every_value_that_leaves_stays(typed: TypedGraph, widest: int, seed: int):
    made = with_sums_of_products(typed, widest)
    equal(typed, made, random.Random(seed))
    for operation in made.graph.operations:
        if isinstance(operation, SumOfProducts):
            for k in operands(operation):
                form = made.formats[k]
                assert form.width + (not form.signed) <= widest
    assert parse_typed_graph(print_typed_graph(made)) == made


def product_sum() -> tuple[Builder, list[int]]:
    b = Builder()
    return b, [b.source(Input(f"z[{k}]"), WORD) for k in range(4)]


def test_a_scalar_product_is_one_operation():
    b, z = product_sum()
    total = b.sum(Add, b.multiply(z[0], z[1]), b.multiply(z[2], z[3]))
    root = b.quantise(total, WORD, Rounding.HALF_UP, Overflow.SATURATE)
    flag = b.flag(Outside(total, WORD, Rounding.HALF_UP))
    made = with_sums_of_products(b.typed({}, {"y": root, "flag": flag}, Rounding.FLOOR), 18)
    kinds = [type(operation) for operation in made.graph.operations]
    assert kinds.count(SumOfProducts) == kinds.count(SumOutside) == 1
    assert not {Add, Multiply, Quantise, Outside} & set(kinds)


def test_a_product_in_two_sums_is_computed_in_both():
    b, z = product_sum()
    shared = b.multiply(z[0], z[1])
    roots = {
        f"y{k}": b.quantise(b.sum(Add, shared, b.multiply(z[k], z[3])), WORD, Rounding.FLOOR, Overflow.WRAP)
        for k in (1, 2)
    }
    typed = b.typed({}, roots, Rounding.FLOOR)
    made = with_sums_of_products(typed, 18)
    assert [len(o.terms) for o in made.graph.operations if isinstance(o, SumOfProducts)] == [2, 2]
    equal(typed, made, random.Random(1))


def test_additions_of_one_value_are_one_product():
    """A constant made of shifts and additions is a constant again, and takes one turn."""
    b, z = product_sum()
    total = b.multiply(z[0], z[1])
    for exponent in (-1, -3, -5, -7, -9, -11):
        total = b.sum(Add, total, b.shift(z[2], exponent))
    typed = b.typed({}, {"y": b.quantise(total, WORD, Rounding.FLOOR, Overflow.SATURATE)}, Rounding.FLOOR)
    made = with_sums_of_products(typed, 18)
    (found,) = (o for o in made.graph.operations if isinstance(o, SumOfProducts))
    assert len(found.terms) == 2
    constants = [o.value for o in made.graph.operations if isinstance(o, Constant)]
    assert constants == [sum((Fraction(1, 1 << e) for e in (1, 3, 5, 7, 9, 11)), Fraction(0))]
    equal(typed, made, random.Random(2))


def test_sums_without_products_keep_their_adders():
    b, z = product_sum()
    root = b.quantise(b.sum(Add, z[0], z[1]), WORD, Rounding.FLOOR, Overflow.SATURATE)
    typed = b.typed({}, {"y": root}, Rounding.FLOOR)
    assert [type(o) for o in with_sums_of_products(typed, 18).graph.operations].count(Add) == 1
