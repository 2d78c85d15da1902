"""Small floating-point graphs, and raw integers that like corners."""

import numpy as np

from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Divide,
    Flag,
    Function,
    Graph,
    Input,
    Multiply,
    Negative,
    Reciprocal,
    Select,
    Shift,
    Subtract,
    Table,
    Unary,
)
from kalmanhdl.numerics.floating import FloatGraph, FloatSpecification, floated

SHIFTS = (-200, -13, -1, 1, 9, 140)


def specification(form: Float, *, fused: bool = False) -> FloatSpecification:
    return FloatSpecification(
        exponent=form.exponent,
        mantissa=form.mantissa,
        rounding=form.rounding,
        subnormals=form.subnormals,
        fused=fused,
    )


def every_operation(form: Float, *, fused: bool = False) -> FloatGraph:
    """A graph of three inputs whose outputs are all operations, by name."""
    operations = [Input("a"), Input("b"), Input("c"), Flag("flag"), Flag("initialise")]
    named = {
        "add": Add(0, 1),
        "subtract": Subtract(0, 1),
        "multiply": Multiply(0, 1),
        "divide": Divide(0, 1),
        "reciprocal": Reciprocal(0),
        "square_root": Unary(Function.SQUARE_ROOT, 0),
        "select": Select(3, 0, 1),
        "negative": Negative(0),
    }
    named |= {f"shift {by}": Shift(0, by) for by in SHIFTS}
    named["wrap"] = Unary(Function.WRAP, 0)
    rows = [form.real(form.nearest(k)) for k in (1, 0.5, -1, 0)]
    named["table"] = Table(0, tuple(rows))
    outputs = []
    for name, operation in named.items():
        outputs.append((name, len(operations)))
        operations.append(operation)
    # Products of their own, each for one sum.
    for name, combined in (
        ("product and sum", lambda product: Add(product, 2)),
        ("product less", lambda product: Subtract(product, 1)),
        ("less product", lambda product: Subtract(0, product)),
    ):
        factors = {"product and sum": (1, 0), "product less": (0, 2), "less product": (2, 1)}[name]
        operations.append(Multiply(*factors))
        operations.append(combined(len(operations) - 1))
        outputs.append((name, len(operations) - 1))
    graph = Graph(tuple(operations), ("test: x",) * len(operations), (), tuple(outputs))
    return floated(graph, specification(form, fused=fused), {})


def every_function(form: Float) -> FloatGraph:
    """A graph of two inputs whose outputs are the functions that are made of other operations, by name."""
    unary = (Function.SINE, Function.COSINE, Function.EXPONENTIAL)
    named = {each.value: Unary(each, 0) for each in unary}
    named |= {each.value: Binary(each, 0, 1) for each in (Function.ARCTANGENT, Function.HYPOTENUSE)}
    operations = (Input("a"), Input("b"), *named.values())
    outputs = tuple((name, 2 + k) for k, name in enumerate(named))
    graph = Graph(operations, ("test: x",) * len(operations), (), outputs)
    return floated(graph, specification(form), {})


def corners(form: Float) -> list[int]:
    """Raw integers at the ends of exponents and significands, of both signs."""
    one = form.bias << form.mantissa
    ends = (0, 1, 2, form.infinity, form.nan, 1 << form.mantissa, 2 << form.mantissa, one, one // 2)
    near = {end + by for end in ends for by in (-1, 0, 1)}
    found = [raw for raw in near if 0 <= raw < form.sign]
    return sorted(found + [raw | form.sign for raw in found])


def raws(form: Float, random: np.random.Generator, shape: tuple[int, ...]):
    """Raw integers: anywhere, near one, or corners."""
    top, integer = 1 << form.width, np.uint64 if form.width == 64 else object
    size = int(np.prod(shape))

    def bits(count: int):
        halves = random.integers(0, 1 << 32, (count, -(-form.width // 32)), np.uint64).astype(object)
        return (halves << np.arange(0, 32 * halves.shape[1], 32).astype(object)).sum(axis=1) % top

    anywhere = bits(size)
    one, spread = form.bias << form.mantissa, 6 << form.mantissa
    near = np.clip(one + (anywhere % (2 * spread)) - spread, 0, form.infinity) | (anywhere & form.sign)
    chosen = random.choice(np.array(corners(form), object), size)
    which = random.random(size)
    mixed = np.where(which < 0.5, near, np.where(which < 0.85, anywhere, chosen))
    return mixed.reshape(shape).astype(integer if form.width >= 64 else np.int64)
