"""What a report counts."""

from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.operations import Function, Input
from kalmanhdl.graph.simplify import counts


def test_functions_are_counted_by_their_names_and_those_that_are_not_there_are_not_named():
    builder = Builder()
    a, b = builder.intern(Input("z[0]")), builder.intern(Input("z[1]"))
    angle = builder.binary(Function.ARCTANGENT, a, b)
    values = [builder.unary(function, angle) for function in (Function.SINE, Function.COSINE)]
    values.append(builder.unary(Function.SQUARE_ROOT, builder.multiply(a, a)))
    values.append(builder.unary(Function.SQUARE_ROOT, b))
    graph = builder.graph([], [(f"y[{k}]", value) for k, value in enumerate(values)])
    found = counts(graph.operations, set(range(len(graph.operations))))
    named = {"multiply": 1, "square_root": 2, "sine": 1, "cosine": 1, "arctangent": 1}
    assert {kind: count for kind, count in found.items() if count} == named
    assert not {"exponential", "hypotenuse", "wrap"} & found.keys()
