"""A graph prints as text and parses back, whatever its names, origins and numbers."""

from dataclasses import fields
from fractions import Fraction
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.errors import DesignError
from kalmanhdl.graph.operations import (
    Boolean,
    Constant,
    Flag,
    Function,
    Graph,
    Input,
    Number,
    Operation,
    Product,
    Quantise,
    Select,
    State,
    Subtract,
    operands,
)
from kalmanhdl.graph.text import parse_graph, print_graph

CLASSES = (*get_args(Number), *get_args(Boolean))
FORMAT = st.builds(Fixed, width=st.integers(1, 99), fraction=st.integers(-99, 99), signed=st.booleans())
VALUES = {
    "name": st.one_of(st.text(), st.sampled_from(("x[0]", "P[0,1]", "valid[1]", "a # b", "c : d", "e = f"))),
    "value": st.one_of(st.fractions(), st.floats(allow_nan=False, allow_infinity=False).map(Fraction)),
    "rows": st.lists(st.fractions(), min_size=1, max_size=5).map(tuple),
    "exponent": st.integers(-99, 99),
    "function": st.sampled_from(Function),
    "form": FORMAT,
    "rounding": st.sampled_from(Rounding),
    "overflow": st.sampled_from(Overflow),
}


def field(name: str, before: int) -> st.SearchStrategy[object]:
    """The values of a field of an operation behind so many others."""
    index = st.integers(0, before - 1)
    if name == "terms":
        return st.lists(st.builds(Product, index, index, st.booleans()), min_size=1, max_size=4).map(tuple)
    return VALUES.get(name, index)


@st.composite
def graphs(draw: st.DrawFn) -> Graph:
    """Any operations in an order in which they could be computed."""
    operations: list[Operation] = []
    for _ in range(draw(st.integers(0, 12))):
        possible = [
            c for c in CLASSES if operations or not {"a", "flag", "terms"} & {f.name for f in fields(c)}
        ]
        cls = draw(st.sampled_from(possible))
        operations.append(cls(*(draw(field(f.name, len(operations))) for f in fields(cls))))
    origins = tuple(draw(st.text() | st.just("update: K[1,0]")) for _ in operations)
    roots = st.tuples(VALUES["name"], st.integers(0, max(0, len(operations) - 1)))
    states, outputs = (draw(st.lists(roots, max_size=3 if operations else 0).map(tuple)) for _ in range(2))
    return Graph(tuple(operations), origins, states, outputs)


@settings(max_examples=200, deadline=None)
@given(graphs())
def test_every_graph_parses_back(graph: Graph):
    assert parse_graph(print_graph(graph)) == graph


@pytest.mark.parametrize("cls", CLASSES)
@given(data=st.data())
@settings(max_examples=5, deadline=None)
def test_every_operation_parses_back(cls: type[Operation], data: st.DataObject):
    before = (Input("z"), Flag("valid"))
    operation = cls(*(data.draw(field(f.name, 2)) for f in fields(cls)))
    graph = Graph((*before, operation), ("", "", ""), (), (("y", 2),))
    parsed = parse_graph(print_graph(graph))
    assert parsed.operations[2] == operation
    assert operands(parsed.operations[2]) == operands(operation)


GRAPH = Graph(
    (
        Flag("valid[0]"),
        Input("z[0]"),
        State("x[0]"),
        Subtract(1, 2),
        Constant(Fraction(1, 3)),
        Constant(Fraction(5, 8)),
        Select(0, 3, 5),
        Quantise(6, Fixed(width=16, fraction=12), Rounding.HALF_UP, Overflow.SATURATE),
    ),
    ("", "measurement: z[0]", "", "update: y[0]", "", "", "update: #1", "\ttab"),
    (("x[0]", 7),),
    (("innovation", 3), ("a name", 4)),
)
TEXT = """\
operations
%0 = flag valid[0]
%1 = input z[0]  # measurement: z[0]
%2 = state x[0]
%3 = subtract %1 %2  # update: y[0]
%4 = constant 1/3
%5 = constant 0.625
%6 = select %0 %3 %5  # update: #1
%7 = quantise %6 fixed(16, fraction=12) half_up saturate  # "\\ttab"
states
x[0] = %7
outputs
innovation = %3
"a name" = %4
"""


def test_a_graph_as_text():
    assert print_graph(GRAPH) == TEXT
    assert parse_graph(TEXT) == GRAPH


@pytest.mark.parametrize(
    ("written", "instead", "message"),
    [
        ("%3 = subtract", "%4 = subtract", "line 5: '%4 = subtract %1 %2  # update: y[0]' is not understood: "
         "write %3 = and an operation such as 'add %0 %1'"),
        ("subtract", "minus", "write %3 = and an operation such as 'add %0 %1'"),
        ("%1 %2", "%1", "write '%3 = subtract %0 %0'"),
        ("%1 %2", "%1 %3", "write operands that stand before %3"),
        ("1/3", "1/0", "line 6"),
        ("1/3", "one", "line 6"),
        ("fixed(16, fraction=12)", "fixed(0, fraction=12)", "a width is 1 bit or more"),
        ("half_up", "up", "'up' is not a valid Rounding"),
        ("x[0] = %7", "x[0] = %8", "line 11: 'x[0] = %8' is not understood: write 'x[0] = %7'"),
        ("outputs\n", "", "the text has no section 'outputs'"),
        ("states\n", "", "line 10: 'x[0] = %7'"),
    ],
)  # fmt: skip
def test_a_line_that_is_not_understood_is_named(written: str, instead: str, message: str):
    with pytest.raises(DesignError) as error:
        parse_graph(TEXT.replace(written, instead, 1))
    assert message in str(error.value)
