"""An estimate of the area of a step under formats, before anything is scheduled or synthesised.

One operator for each operation, its LUTs from the device's table of synthesised operators, without registers.
A multiplication takes the multiplier blocks of its limbs and the adders behind them or, where an operand is
narrow, its Booth rows. A block counts as many LUTs as the device has for each of its blocks. A function is
made of the operations that the hardware makes it of.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.division import DivisionMethod, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.product_structure import block_addends, booth_rows, limb_widths, logic_addends
from kalmanhdl.explore.format_engine import FormatEngine, Run
from kalmanhdl.explore.program import Code, Step
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Flag,
    Function,
    Graph,
    Input,
    Multiply,
    Operation,
    Quantise,
    Select,
    Subtract,
    Table,
    Unary,
    operands,
)
from kalmanhdl.numerics.functions.method import FunctionMethod
from kalmanhdl.numerics.quantise import quantise
from kalmanhdl.numerics.ranges import Ranges
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.target import device as known_device
from kalmanhdl.target.device import Device

# A multiplication of so few rows costs less in logic than the way to a block.
_ROWS_IN_LOGIC = 4


def estimated_luts(
    engine: FormatEngine, run: Run, device: Device, functions: FunctionMethod | None = None
) -> float:
    """LUTs of a program under the formats of a run, those that stand for multiplier blocks included."""
    types, total = run.types, 0.0
    for index in np.flatnonzero(types["live"]).tolist():
        step, width = engine.program.steps[index], int(types["width"][index])
        if step.code is Code.FUNCTION:
            total += _function(engine, types, index, device, functions)
        else:
            total += _step(engine, types, index, step, width, device)
    return total


def _step(
    engine: FormatEngine, types: NDArray[np.void], index: int, step: Step, width: int, device: Device
) -> float:
    match step.code:
        case Code.ADD | Code.SUBTRACT:
            return device.area_luts("add", width)
        case Code.SELECT:
            return device.area_luts("select", width)
        case Code.SCALE:
            return device.area_luts("add", width) * (_digits(types["value"][index]) - 1)
        case Code.QUANTISE:
            if types["at"][index] != index:
                return 0.0
            return _quantised(width, engine.rounding, bool(types["leaves"][index]), device)
        case Code.MULTIPLY:
            (x, p), (y, q) = (_operand(types, k) for k in (step.a, step.b))
            return _product(x, p, y, q, device)
        case Code.DIVIDE:
            return device.area_luts("divide", width * (_operand(types, step.b)[0] + 1))
        case Code.RECIPROCAL:
            return _reciprocal(engine.division, _operand(types, step.a)[0], width, device)
        case Code.TABLE:
            return width * device.area_luts("table", _operand(types, step.a)[0])
        case _:
            return 0.0


def _operand(types: NDArray[np.void], index: int) -> tuple[int, bool]:
    """Width and sign of the value that a step reads."""
    at = int(types["at"][index])
    return int(types["width"][at]), bool(types["low"][at] < 0)


def _quantised(width: int, rounding: Rounding, leaves: bool, device: Device) -> float:
    """Rounding up or down takes an adder, staying inside a format a choice."""
    clamp = device.area_luts("clamp", width)
    adder = 0.0 if rounding is Rounding.FLOOR else max(0.0, device.area_luts("round", width) - clamp)
    return adder + clamp * leaves


def _product(x: int, p: bool, y: int, q: bool, device: Device) -> float:
    if min(booth_rows(x, p), booth_rows(y, q)) <= _ROWS_IN_LOGIC:
        return device.area_luts("multiply", logic_addends(x, p, y, q) * max(x, y))
    blocks = len(limb_widths(x, p, q)) * len(limb_widths(y, q, p))
    adders = (block_addends(x, p, y, q) - 1) * device.area_luts("add", x + y)
    return blocks * device.luts / max(device.multipliers, 1) + adders


def _reciprocal(method: DivisionMethod, divisor: int, width: int, device: Device) -> float:
    if not isinstance(method, TableNewton):
        return device.area_luts("divide", width * (divisor + 1))
    normalised = device.area_luts("leading_one", divisor) + device.area_luts("shift", divisor)
    bits = method.index_bits + 2
    total = (
        normalised + bits * device.area_luts("table", method.index_bits) + device.area_luts("shift", width)
    )
    for _ in range(method.iterations):
        total += _product(divisor, False, bits, False, device)
        bits = min(2 * bits, max(width + 2, bits))
        total += _product(bits, False, bits, False, device)
    return total


def _digits(value: float) -> int:
    """The signed digits of a constant."""
    magnitude = abs(int(np.ldexp(np.frexp(value)[0], 53)))
    return ((3 * magnitude) ^ magnitude).bit_count()


def _function(
    engine: FormatEngine,
    types: NDArray[np.void],
    index: int,
    device: Device,
    method: FunctionMethod | None,
) -> float:
    step = engine.program.steps[index]
    places = (step.a,) if step.a == step.b else (step.a, step.b)
    arguments = tuple(
        Fixed(width=width, fraction=int(types["fraction"][types["at"][place]]), signed=signed)
        for place in places
        for width, signed in (_operand(types, place),)
    )
    result = Fixed(
        width=int(types["width"][index]),
        fraction=int(types["fraction"][index]),
        signed=bool(types["low"][index] < 0),
    )
    function = list(Function)[step.c]
    return _function_luts(function, arguments, result, method, engine.rounding, device.name, device.grade)


@lru_cache(maxsize=4096)
def _function_luts(
    function: Function,
    arguments: tuple[Fixed, ...],
    result: Fixed,
    method: FunctionMethod | None,
    rounding: Rounding,
    device_name: str,
    grade: int,
) -> float:
    """The operations of a function by itself, of arguments in formats of their own."""
    names = [f"z[{k}]" for k in range(len(arguments))]
    operation: Operation = Unary(function, 1) if len(names) == 1 else Binary(function, 1, 2)
    graph = Graph(
        (Flag("initialise"), *map(Input, names), operation),
        ("", *(f"measurement: {name}" for name in names), "predict: f[0]"),
        (),
        (("f[0]", len(names) + 1),),
    )
    specification = FixedSpecification(
        functions=method,
        rounding=rounding,
        signals={**dict(zip(names, arguments, strict=True)), "f[0]": result},
    )
    ones = (1.0,) * len(graph.operations)
    typed = quantise(graph, Ranges(low=(0.0,) * len(ones), high=ones), specification, {})
    formats, total, part = typed.formats, 0.0, known_device(device_name, grade)
    for index, each in enumerate(typed.graph.operations):
        form = formats[index]
        if form is None:
            continue
        inner = [formats[k] for k in operands(each)]
        total += _typed(each, form, [f for f in inner if f is not None], rounding, part)
    return total


def _typed(
    operation: Operation, form: Fixed, inner: list[Fixed], rounding: Rounding, device: Device
) -> float:
    match operation:
        case Add() | Subtract():
            return device.area_luts("add", form.width)
        case Select():
            return device.area_luts("select", form.width)
        case Quantise():
            return _quantised(form.width, rounding, True, device)
        case Multiply():
            x, y = inner
            return _product(x.width, x.signed, y.width, y.signed, device)
        case Table():
            return form.width * device.area_luts("table", inner[0].width)
        case _:
            return 0.0
