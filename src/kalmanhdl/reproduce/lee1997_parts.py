"""The nine parts of lee1997's filter as graphs of integers: equations (14) to (19) written out as there.

The paper divides each of three parts into three areas, and its text shows neither. Their sizes tell: P1B and
P1C are alike, P2B and P2C, P3B and P3C. Here A predicts (and divides), B and C update with a gain each.
"""

from dataclasses import dataclass, field
from fractions import Fraction

from kalmanhdl.arithmetic.division import LongDivision
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.graph.operations import (
    Add,
    Bits,
    Constant,
    Divide,
    Graph,
    Input,
    Multiply,
    Number,
    Shift,
    Subtract,
)
from kalmanhdl.numerics.interval import Typed, type_of
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.reproduce.facts import facts

# What is divided, and by what (section 5.3).
_QUOTIENT = Fixed(width=17, fraction=0, signed=False)
_PERIOD = 4
"""T = 15 s: sixteen times less one."""


@dataclass(slots=True)
class _Steps:
    """Operations, their types and their outputs, in the order in which they are asked for."""

    operations: list[Number] = field(default_factory=list)
    types: list[Typed | None] = field(default_factory=list)
    outputs: list[tuple[str, int]] = field(default_factory=list)

    def __call__(self, operation: Number, given: Fixed | None = None) -> int:
        self.operations.append(operation)
        self.types.append(type_of(operation, self.types, given))
        return len(self.operations) - 1

    def bits(self, a: int, form: Fixed) -> int:
        """The bits of a that a format has."""
        return self(Bits(a, form))

    def times_period(self, a: int) -> int:
        """T a."""
        return self(Subtract(self(Shift(a, _PERIOD)), a))

    def shown(self, name: str, a: int) -> None:
        """An output."""
        self.outputs.append((name, a))

    def typed(self, product: LogicProduct) -> TypedGraph:
        """The graph."""
        count = len(self.operations)
        known = [found for found in self.types if found is not None]
        origins = tuple("predict: step" for _ in range(count))
        return TypedGraph(
            Graph(tuple(self.operations), origins, (), tuple(self.outputs)),
            tuple(form for form, _ in known),
            tuple(interval for _, interval in known),
            LongDivision(radix=2),
            Rounding.FLOOR,
            (),
            {},
            product,
        )


def parts(product: LogicProduct) -> dict[str, TypedGraph]:
    """The nine parts by their names in table 1, with multipliers of a kind."""
    bits, chosen = facts("lee1997")["bits"], facts("lee1997")["chosen"]
    found = {}
    for number, axis in enumerate(("range", "bearing"), start=1):
        kept = Fixed(width=bits[f"{axis}_covariance"], fraction=0)
        predicted = Fixed(width=chosen[f"{axis}_predicted"], fraction=0)
        found[f"P{number}A"] = _gains(kept, predicted)
        for row, letter in enumerate("BC"):
            found[f"P{number}{letter}"] = _covariance(kept, predicted, row)
    found["P3A"] = _prediction()
    found |= {"P3B": _state(), "P3C": _state()}
    return {name: found[name].typed(product) for name in facts("lee1997")["cells"]}


def sum_of(width: int) -> TypedGraph:
    """A sum of so many bits."""
    steps, form = _Steps(), Fixed(width=width, fraction=0)
    total = steps(Add(*(steps(Input(f"z[{k}]"), form) for k in range(2))))
    steps.shown("x[0]", steps.bits(total, form))
    return steps.typed(LogicProduct.BOOTH)


def _gain() -> Fixed:
    width = facts("lee1997")["bits"]["gain"]
    return Fixed(width=width, fraction=width, signed=False)


def _gains(kept: Fixed, predicted: Fixed) -> _Steps:
    """Equations (14) and (17): the predicted covariance, and both gains of an axis."""
    steps = _Steps()
    P11, P12, P21, P22 = (steps(Input(f"P[{i},{j}]"), kept) for i in range(2) for j in range(2))
    # Constants change nothing but single cells: over the process noise it is one, here and in the paper.
    one, noise = steps(Constant(Fraction(1))), steps(Constant(Fraction(3030)))
    across = steps.times_period(P22)
    P1_12, P1_21 = (steps.bits(steps(Add(each, across)), predicted) for each in (P12, P21))
    sides = steps(Add(steps.times_period(P12), steps.times_period(P1_12)))
    P1_11 = steps.bits(steps(Add(P11, sides)), predicted)
    P1_22 = steps.bits(steps(Add(P22, one)), predicted)
    S = steps.bits(steps(Add(P1_11, noise)), _QUOTIENT)
    for row, dividend in enumerate((P1_11, P1_21)):
        gain = steps(Divide(steps.bits(dividend, _QUOTIENT), S), _gain())
        steps.shown(f"K[{row},0]", gain)
    for name, value in (("P[0,0]", P1_11), ("P[0,1]", P1_12), ("P[1,0]", P1_21), ("P[1,1]", P1_22)):
        steps.shown(name, value)
    return steps


def _covariance(kept: Fixed, predicted: Fixed, row: int) -> _Steps:
    """Equation (19): one row of the updated covariance, with the gain of that row."""
    steps = _Steps()
    gain = steps(Input(f"K[{row},0]"), _gain())
    above = [steps(Input(f"P[0,{column}]"), predicted) for column in range(2)]
    own = above if row == 0 else [steps(Input(f"P[1,{column}]"), predicted) for column in range(2)]
    for column in range(2):
        product = steps.bits(steps(Multiply(above[column], gain)), predicted)
        steps.shown(f"P[{row},{column}]", steps.bits(steps(Subtract(own[column], product)), kept))
    return steps


def _prediction() -> _Steps:
    """Equations (15) and (16): the predicted state of both axes, and the innovations."""
    steps = _Steps()
    bits, chosen = facts("lee1997")["bits"], facts("lee1997")["chosen"]
    form, innovation = Fixed(width=bits["state"], fraction=0), Fixed(width=chosen["innovation"], fraction=0)
    for axis in range(2):
        place, rate = (steps(Input(f"x[{2 * axis + k}]"), form) for k in range(2))
        plot = steps(Input(f"z[{axis}]"), form)
        predicted = steps.bits(steps(Add(place, steps.times_period(rate))), form)
        steps.shown(f"x[{2 * axis}]", predicted)
        steps.shown(f"y[{axis}]", steps.bits(steps(Subtract(plot, predicted)), innovation))
    return steps


def _state() -> _Steps:
    """Equation (18) for one axis."""
    steps = _Steps()
    bits, chosen = facts("lee1997")["bits"], facts("lee1997")["chosen"]
    form = Fixed(width=bits["state"], fraction=0)
    innovation = steps(Input("z[0]"), Fixed(width=chosen["innovation"], fraction=0))
    for row in range(2):
        gain, predicted = steps(Input(f"K[{row},0]"), _gain()), steps(Input(f"x[{row}]"), form)
        change = steps.bits(steps(Multiply(innovation, gain)), form)
        steps.shown(f"x[{row}]", steps.bits(steps(Add(predicted, change)), form))
    return steps
