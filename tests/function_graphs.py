"""Graphs with functions beyond arithmetic, and what the functions are in exact arithmetic."""

from dataclasses import dataclass
from fractions import Fraction

import mpmath
import numpy as np

from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Flag,
    Function,
    Graph,
    Input,
    Multiply,
    Select,
    Shift,
    State,
    Unary,
)
from kalmanhdl.numerics.functions.method import FunctionMethod
from kalmanhdl.numerics.quantise import quantise
from kalmanhdl.numerics.ranges import Ranges
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.simulate.engine import Engine


def alone(
    function: Function,
    arguments: tuple[Fixed, ...],
    result: Fixed,
    method: FunctionMethod | None,
    rounding: Rounding = Rounding.HALF_UP,
) -> TypedGraph:
    """A function of inputs ``z[k]`` as the output ``f[0]``, in formats that are given."""
    names = [f"z[{k}]" for k in range(len(arguments))]
    places = range(1, 1 + len(names))
    operation = Unary(function, 1) if len(names) == 1 else Binary(function, *places)
    operations = (Flag("initialise"), *map(Input, names), operation)
    origins = ("", *(f"measurement: {name}" for name in names), "predict: f[0]")
    graph = Graph(operations, origins, (), (("f[0]", len(names) + 1),))
    specification = FixedSpecification(
        functions=method,
        rounding=rounding,
        signals={**dict(zip(names, arguments, strict=True)), "f[0]": result},
    )
    ends = (0.0,) * len(operations), (1.0,) * len(operations)
    return quantise(graph, Ranges(low=ends[0], high=ends[1]), specification, {})


def values(typed: TypedGraph, *raws: np.ndarray) -> list[Fraction]:
    """The values of ``f[0]`` for raw inputs, by the engine."""
    inputs = {f"z[{k}]": np.asarray(raw)[None, :] for k, raw in enumerate(raws)}
    flags = {"initialise": np.zeros((1, len(raws[0])), bool)}
    found = Engine.of(typed).run(inputs, flags).outputs["f[0]"][0]
    form = typed.formats[typed.graph.outputs[0][1]]
    return [form.real(int(raw)) for raw in found]


def exact(function: Function, *arguments: Fraction) -> mpmath.mpf:
    """The value of a function to 40 digits; angles in turns."""
    with mpmath.workdps(40):
        a, *b = (mpmath.mpf(x.numerator) / x.denominator for x in arguments)
        match function:
            case Function.SINE:
                return mpmath.sinpi(2 * a)
            case Function.COSINE:
                return mpmath.cospi(2 * a)
            case Function.SQUARE_ROOT:
                return mpmath.sqrt(max(a, 0))
            case Function.EXPONENTIAL:
                return mpmath.exp(a)
            case Function.WRAP:
                return a - mpmath.floor(a + 0.5)
            case Function.ARCTANGENT:
                return mpmath.atan2(a, b[0]) / (2 * mpmath.pi)
            case Function.HYPOTENUSE:
                return mpmath.hypot(a, b[0])


def errors(
    function: Function, arguments: tuple[Fixed, ...], result: Fixed, typed: TypedGraph, *raws: np.ndarray
) -> np.ndarray:
    """By how many last bits of the result the engine is above the exact value, clamped to the format."""
    found = values(typed, *raws)
    limits = [mpmath.mpf(raw) for raw in (result.lowest, result.highest)]
    above = []
    for index, value in enumerate(found):
        given = (form.real(int(raw[index])) for form, raw in zip(arguments, raws, strict=True))
        with mpmath.workdps(40):
            wanted = exact(function, *given) * mpmath.mpf(2) ** result.fraction
            raw = mpmath.mpf(value.numerator) / value.denominator * mpmath.mpf(2) ** result.fraction
            above.append(float(raw - min(max(wanted, limits[0]), limits[1])))
    return np.array(above)


@dataclass(frozen=True)
class Robot:
    """A step that uses every function: a heading that turns, a way from it, and what is seen of the way."""

    width: int
    method: FunctionMethod | None

    @property
    def typed(self) -> TypedGraph:
        """The step in integers."""
        operations = (
            Flag("initialise"),  # 0
            Input("z[0]"),  # 1: by how much it turns
            Input("z[1]"),  # 2: how far it goes
            State("x[0]"),  # 3: where it heads
            State("x[1]"),  # 4
            State("x[2]"),  # 5
            Add(1, 3),
            Unary(Function.WRAP, 6),
            Select(0, 1, 7),
            Unary(Function.COSINE, 7),
            Unary(Function.SINE, 7),
            Multiply(2, 9),
            Multiply(2, 10),
            Shift(4, -1),
            Shift(5, -1),
            Add(11, 13),
            Add(12, 14),
            Select(0, 2, 15),
            Select(0, 1, 16),
            Binary(Function.ARCTANGENT, 5, 4),
            Binary(Function.HYPOTENUSE, 5, 4),
            Unary(Function.SQUARE_ROOT, 20),
            Shift(20, -3),
            Unary(Function.EXPONENTIAL, 22),
        )
        origins = ["", *(f"measurement: z[{k}]" for k in range(2)), *(f"state: x[{k}]" for k in range(3))]
        origins += ["predict: turn term", "posterior: x[0]", "posterior: x[0]", "cosine", "sine"]
        origins += ["predict: way term"] * 6 + ["posterior: x[1]", "posterior: x[2]"]
        origins += ["bearing", "range", "root", "range term", "growth"]
        states = (("x[0]", 8), ("x[1]", 17), ("x[2]", 18))
        outputs = (("bearing", 19), ("range", 20), ("root", 21), ("growth", 23), ("sine", 10))
        graph = Graph(operations, tuple(origins), states, outputs)
        low = [0.0, -0.4, -3.0, -0.5, -5.0, -5.0, -0.9, -0.5, -0.5, -1.0, -1.0, -3.0, -3.0]
        low += [-2.5, -2.5, -5.0, -5.0, -5.0, -5.0, -0.5, 0.0, 0.0, 0.0, 1.0]
        high = [1.0, 0.4, 3.0, 0.5, 5.0, 5.0, 0.9, 0.5, 0.5, 1.0, 1.0, 3.0, 3.0]
        high += [2.5, 2.5, 5.0, 5.0, 5.0, 5.0, 0.5, 7.0, 2.7, 0.9, 2.5]
        specification = FixedSpecification(width=self.width, functions=self.method)
        return quantise(graph, Ranges(low=tuple(low), high=tuple(high)), specification, {})
