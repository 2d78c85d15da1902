"""Operations whose results are one and the same wire of the hardware.

What comes out of a shared operator is the result of every operation that takes turns on it, each in its own
cycle; and what only rounds or judges such a result in that cycle is built once for all of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.graph.operations import Bits, Divide, Negative, Outside, Quantise, Reciprocal, Shift
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph


@dataclass(frozen=True, slots=True)
class FromUnit:
    """The result of a shared operator, by its number, with so many fraction bits."""

    unit: int
    fraction: int


@dataclass(frozen=True, slots=True)
class Own:
    """The result of an operation of its own."""

    operation: int


@dataclass(frozen=True, slots=True)
class Rounded:
    """A result quantised; ``outside`` instead whether it does not fit."""

    source: "Wire"
    form: Fixed
    rounding: Rounding
    overflow: Overflow
    outside: bool = False


@dataclass(frozen=True, slots=True)
class Moved:
    """A result whose binary point was moved."""

    source: "Wire"
    exponent: int


@dataclass(frozen=True, slots=True)
class Cut:
    """Some bits of a result; without a form its sign."""

    source: "Wire"
    form: Fixed | None


Wire = FromUnit | Own | Rounded | Moved | Cut


def source(wire: Wire) -> Wire:
    """What raw integers come from, wherever their binary point stands."""
    return replace(wire, fraction=0) if isinstance(wire, FromUnit) else wire


@dataclass(slots=True)
class Wires:
    """The wire of every operation. ``unit`` gives the shared operator of those that have one."""

    typed: TypedGraph | FloatGraph
    start: Sequence[int]
    end: Sequence[int]
    unit: Mapping[int, int]
    _known: dict[int, Wire] = field(default_factory=dict)

    def of(self, index: int) -> Wire:
        """The wire on which the result of an operation is in the cycle of its end."""
        if index not in self._known:
            self._known[index] = self._wire(index)
        return self._known[index]

    def _wire(self, index: int) -> Wire:
        if isinstance(self.typed, FloatGraph):
            return FromUnit(self.unit[index], 0) if index in self.unit else Own(index)
        if index in self.unit:
            form = self.typed.formats[index]
            assert form is not None
            result = FromUnit(self.unit[index], form.fraction)
            if isinstance(self.typed.graph.operations[index], Divide | Reciprocal):
                # The shared divider has the widest of its formats; each quotient saturates in its own.
                return Rounded(result, form, Rounding.FLOOR, Overflow.SATURATE)
            return result
        match self.typed.graph.operations[index]:
            case Quantise(a, form, rounding, overflow) if (wire := self._chained(index, a)) is not None:
                return Rounded(wire, form, rounding, overflow)
            case Outside(a, form, rounding) if (wire := self._chained(index, a)) is not None:
                return Rounded(wire, form, rounding, Overflow.WRAP, outside=True)
            case Shift(a, exponent) if (wire := self._chained(index, a)) is not None:
                return Moved(wire, exponent)
            case Bits(a, form) if (wire := self._chained(index, a)) is not None:
                return Cut(wire, form)
            case Negative(a) if (wire := self._chained(index, a)) is not None:
                return Cut(wire, None)
            case _:
                return Own(index)

    def _chained(self, index: int, operand: int) -> Wire | None:
        """The operand's wire, where it comes from a shared operator in the very cycle in which it is read."""
        if self.start[index] != self.end[operand] or self.end[index] != self.start[index]:
            return None
        wire = self.of(operand)
        return None if isinstance(wire, Own) else wire
