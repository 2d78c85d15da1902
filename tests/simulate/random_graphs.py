"""Random typed graphs of all operations, and data that likes corners."""

from dataclasses import replace
from random import Random

import numpy as np
from conftest import Builder

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.graph.operations import Flag, Input, State
from kalmanhdl.numerics.typed import TypedGraph, Violation

WIDTHS = (*range(1, 20), 30, 31, 32, 33, 34, 62, 63, 64, 65, 66, 120, 127, 128, 129, 200)


def random_graph(random: Random, operations: int = 14) -> TypedGraph:
    """A graph with states of both kinds, inputs, and random operations on them."""
    widest = random.choice((16, 24, 33, 64, 200))
    b = Builder(_method(random), random.choice(list(Rounding)))
    numbers = [b.input(f"z[{k}]", _form(random, widest)) for k in range(2)]
    states = [b.state(f"x[{k}]", _form(random, widest)) for k in range(2)]
    numbers += [*states, b.constant(random.randint(-40, 40), random.randint(0, 3))]
    flags = [b.flag("initialise"), b.flag("valid[0]"), b.state_flag("saturated")]
    while len(b.operations) < operations + 8:
        _extend(b, random, widest, numbers, flags)
    for k, state in enumerate(states):
        form = b.formats[state]
        numbers.append(b.quantise(random.choice(numbers), form, _rounding(random), _overflow(random)))
        b.states[f"x[{k}]"] = numbers[-1]
    b.states["saturated"] = random.choice(flags)
    b.outputs = {f"y[{k}]": random.choice(numbers) for k in range(3)} | {"flag": random.choice(flags)}
    value, form, rounding = random.choice(numbers), _form(random, widest), _rounding(random)
    violation = Violation(
        quantise=b.quantise(value, form, rounding),
        outside=b.outside(value, form, rounding),
        starting=random.random() < 0.5,
        running=random.random() < 0.5,
    )
    return replace(b.typed(), violations=(violation,))


def random_inputs(random: Random, typed: TypedGraph, steps: int, tracks: int):
    """Inputs and flags by name, where tracks are active, and a state to start from."""
    inputs, flags, state = {}, {}, {}
    shape = (steps, tracks)
    for operation, form in zip(typed.graph.operations, typed.formats, strict=True):
        if isinstance(operation, Input):
            inputs[operation.name] = _numbers(random, form, shape)
        elif isinstance(operation, Flag):
            flags[operation.name] = np.array([random.random() < 0.5 for _ in range(steps * tracks)]).reshape(
                shape
            )
        elif isinstance(operation, State):
            state[operation.name] = _numbers(random, form, (tracks,))
    active = np.array([random.random() < 0.8 for _ in range(steps * tracks)]).reshape(shape)
    return inputs, flags, active, state


def _numbers(random: Random, form: Fixed, shape: tuple[int, ...]):
    corners = (form.lowest, form.lowest + 1, -1, 0, 1, form.highest - 1, form.highest)
    inside = [n for n in corners if form.lowest <= n <= form.highest]
    result = np.empty(shape, object)
    for place in np.ndindex(shape):
        far = random.randint(form.lowest, form.highest)
        near = far >> random.randrange(form.width)
        result[place] = random.choice((random.choice(inside), far, near))
    return result


def _method(random: Random) -> DivisionMethod:
    if random.random() < 0.5:
        return LongDivision()
    return TableNewton(index_bits=random.randint(1, 6), iterations=random.randint(0, 3))


def _form(random: Random, widest: int) -> Fixed:
    width = random.choice([w for w in WIDTHS if w <= widest])
    return Fixed(width=width, fraction=random.randint(-3, width + 3), signed=random.random() < 0.6)


def _rounding(random: Random) -> Rounding:
    return random.choice(list(Rounding))


def _overflow(random: Random) -> Overflow:
    return random.choice(list(Overflow))


def _extend(b: Builder, random: Random, widest: int, numbers: list[int], flags: list[int]) -> None:
    """Add one random operation."""
    a, c = random.choice(numbers), random.choice(numbers)
    f, g = random.choice(flags), random.choice(flags)
    form = _form(random, widest)
    short = b.formats[a].width + b.formats[c].width < 3 * widest + 40
    match random.randrange(15):
        case 0 if short:
            numbers.append(b.add(a, c))
        case 1 if short:
            numbers.append(b.subtract(a, c))
        case 2 | 3 if short:
            numbers.append(b.multiply(a, c))
        case 4:
            numbers.append(b.shift(a, random.randint(-5, 5)))
        case 5:
            numbers.append(b.divide(a, c, form))
        case 6:
            numbers.append(b.reciprocal(a, form))
        case 7 if short:
            numbers.append(b.select(f, a, c))
        case 8 | 9:
            numbers.append(b.quantise(a, form, _rounding(random), _overflow(random)))
        case 10:
            flags.append(b.outside(a, form, _rounding(random)))
        case 12:
            fraction = b.formats[a].fraction - random.randint(0, 5)
            numbers.append(b.bits(a, replace(form, fraction=fraction)))
        case 13:
            number = b.shift(b.bits(a, Fixed(width=3, fraction=form.fraction, signed=False)), form.fraction)
            limit = 1 << random.randrange(widest)
            rows = tuple(random.randint(-limit, limit) for _ in range(8))
            numbers.append(b.table(number, rows, random.randint(-3, widest)))
        case 14:
            flags.append(b.negative(a))
        case 11:
            flags.append(random.choice((b.both, b.either))(f, g))
            flags.append(b.negate(flags[-1]))
