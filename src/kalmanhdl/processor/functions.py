"""What FUNC computes: functions of numbers of the core's format, as operations on integers or on floats.

One graph of a core's functions is their definition: the simulator interprets it, the hardware is built of it.
"""

from dataclasses import dataclass, replace
from functools import cache, lru_cache

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.builder import Builder, reachable, with_operands
from kalmanhdl.graph.operations import (
    Binary,
    Flag,
    Function,
    Graph,
    Input,
    NotFinite,
    Operation,
    Unary,
    operands,
)
from kalmanhdl.numerics.float_functions import without_functions
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.functions.method import Cordic
from kalmanhdl.numerics.quantise import quantise
from kalmanhdl.numerics.ranges import Ranges
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.processor.core import Core
from kalmanhdl.simulate.float_interpreter import interpret_float
from kalmanhdl.simulate.interpreter import interpret

ARGUMENTS = ("z[0]", "z[1]")
"""The inputs of the graph: elements 0 and 1 of the source."""

OF_TWO = (Function.ARCTANGENT, Function.HYPOTENUSE)
"""The functions of two numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Root:
    """Where the value of a function stands in the graph, and the flags one of which says that it did not
    fit."""

    function: Function
    value: int
    outside: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FunctionGraph:
    """The functions of a core together; equal operations are one."""

    typed: TypedGraph | FloatGraph
    roots: tuple[Root, ...]

    def alone(self, function: Function) -> "FunctionGraph":
        """What one function needs."""
        return _reduced(self.typed, [root for root in self.roots if root.function is function])


@cache
def function_graph(core: Core) -> FunctionGraph:
    """The functions of a core.

    In fixed point each is rounded and clamped into the format once, in floating point they are those of
    ``numerics.float_functions``, and one that is not finite does not fit.
    """
    return _float_graph(core) if core.floating else _fixed_graph(core)


def _asked(core: Core) -> Graph:
    """The functions as single operations; their arguments are the first inputs."""
    arguments: list[Operation] = [Flag("initialise"), *map(Input, ARGUMENTS)]
    functions: list[Operation] = [
        Binary(each, 1, 2) if each in OF_TWO else Unary(each, 1) for each in core.functions
    ]
    operations = (*arguments, *functions)
    names = _names(core)
    origins = ("", *(f"measurement: {name}" for name in ARGUMENTS), *(f"predict: {name}" for name in names))
    outputs = tuple((name, len(arguments) + k) for k, name in enumerate(names))
    return Graph(operations, origins, (), outputs)


def _names(core: Core) -> list[str]:
    return [f"f[{k}]" for k in range(len(core.functions))]


def _fixed_graph(core: Core) -> FunctionGraph:
    names, asked = _names(core), _asked(core)
    # A length is found on the way to an angle: both share their hardware.
    method = Cordic() if set(OF_TWO) & set(core.functions) else None
    read = ARGUMENTS if set(OF_TWO) & set(core.functions) else ARGUMENTS[:1]
    specification = FixedSpecification(
        functions=method,
        rounding=core.rounding,
        overflow=core.overflow,
        signals=dict.fromkeys((*read, *names), core.fixed_form),
    )
    anything = Ranges(low=(-1.0,) * len(asked.operations), high=(1.0,) * len(asked.operations))
    typed = quantise(asked, anything, specification, {})
    found = dict(typed.graph.outputs)
    roots = []
    for name, function in zip(names, core.functions, strict=True):
        needed = reachable(typed.graph.operations, [found[name]])
        flags = tuple(each.outside for each in typed.violations if each.quantise in needed)
        roots.append(Root(function=function, value=found[name], outside=flags))
    return _reduced(typed, roots)


def _float_graph(core: Core) -> FunctionGraph:
    form, (graph, _) = core.float_form, without_functions(_asked(core), core.float_form)
    builder, found = Builder.of(graph), dict(graph.outputs)
    roots = [
        Root(function=each, value=found[name], outside=(builder.intern(NotFinite(found[name])),))
        for name, each in zip(_names(core), core.functions, strict=True)
    ]
    watched = Graph(tuple(builder.operations), tuple(builder.origins), (), graph.outputs)
    typed = FloatGraph(graph=watched, form=form, fused=frozenset(), violations=(), scales={})
    return _reduced(typed, roots)


def _reduced(typed: TypedGraph | FloatGraph, roots: list[Root]) -> FunctionGraph:
    """What some functions need of a graph."""
    operations = typed.graph.operations
    kept = sorted(reachable(operations, [k for root in roots for k in (root.value, *root.outside)]))
    place = {old: new for new, old in enumerate(kept)}
    graph = Graph(
        operations=tuple(
            with_operands(operations[k], tuple(place[i] for i in operands(operations[k]))) for k in kept
        ),
        origins=tuple(typed.graph.origins[k] for k in kept),
        states=(),
        outputs=tuple((root.function.value, place[root.value]) for root in roots),
    )
    reduced: TypedGraph | FloatGraph
    if isinstance(typed, FloatGraph):
        reduced = replace(typed, graph=graph)
    else:
        reduced = replace(
            typed,
            graph=graph,
            formats=tuple(typed.formats[k] for k in kept),
            intervals=tuple(typed.intervals[k] for k in kept),
            violations=(),
        )
    moved = tuple(
        Root(
            function=root.function,
            value=place[root.value],
            outside=tuple(place[flag] for flag in root.outside),
        )
        for root in roots
    )
    return FunctionGraph(typed=reduced, roots=moved)


@cache
def _alone(core: Core, function: Function) -> FunctionGraph:
    return function_graph(core).alone(function)


@lru_cache(maxsize=1 << 16)
def function_value(core: Core, function: Function, a: int, b: int) -> tuple[int, bool]:
    """The raw value of a function of raw numbers, and whether it did not fit the format."""
    graph, given = _alone(core, function), dict(zip(ARGUMENTS, (a, b), strict=True))
    (root,) = graph.roots
    if isinstance(graph.typed, FloatGraph):
        values = interpret_float(graph.typed, given, {}).values
        return values[root.value], bool(values[root.outside[0]])
    values = interpret(graph.typed, given, {}).values
    form = graph.typed.formats[root.value]
    assert isinstance(form, Fixed)
    bits = core.fixed_form.fraction - form.fraction
    return values[root.value] << bits, any(values[k] for k in root.outside)
