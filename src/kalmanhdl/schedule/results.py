"""Operations whose results are one and the same wire of the hardware.

What comes out of a shared operator is the result of every operation that takes turns on it, each in its own
cycle; and what only rounds or judges such a result in that cycle is built once for all of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.graph.operations import (
    Bits,
    Constant,
    Divide,
    Negative,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    SumOutside,
)
from kalmanhdl.numerics.floating import FloatGraph
from kalmanhdl.numerics.typed import TypedGraph


@dataclass(frozen=True, slots=True)
class FromUnit:
    """The result of a shared operator, by its number, with so many fraction bits."""

    unit: int
    fraction: int


@dataclass(frozen=True, slots=True)
class OnBus:
    """The result of a sum of products, on a bus by its number, with so many fraction bits.

    Or what a ``Select`` makes of it, see ``Wires.guarded``.
    """

    bus: int
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


Wire = FromUnit | OnBus | Own | Rounded | Moved | Cut


def source(wire: Wire) -> Wire:
    """What raw integers come from, wherever their binary point stands."""
    return replace(wire, fraction=0) if isinstance(wire, FromUnit | OnBus) else wire


@dataclass(slots=True)
class Wires:
    """The wire of every operation.

    ``unit`` gives the shared operator of those that have one, ``bus`` the bus on which those leave that do.
    """

    typed: TypedGraph | FloatGraph
    start: Sequence[int]
    end: Sequence[int]
    unit: Mapping[int, int]
    bus: Mapping[int, int]
    _known: dict[int, Wire] = field(default_factory=dict)

    def of(self, index: int) -> Wire:
        """The wire on which the result of an operation is in the cycle of its end."""
        if index not in self._known:
            self._known[index] = self._wire(index)
        return self._known[index]

    def guarded(self, index: int) -> int | None:
        """The sum in whose cycle a bus carries what this operation chooses: the sum, or a constant.

        So it is where nothing else reads the sum, and the flag was there before.
        """
        graph = self.typed.graph
        match graph.operations[index]:
            case Select(flag, a, b) if self.end[flag] < self.end[index]:
                sums = (
                    k
                    for k, other in ((a, b), (b, a))
                    if k in self.bus and isinstance(graph.operations[other], Constant)
                )
                return next((k for k in sums if self._read_only_by(k, index)), None)
            case _:
                return None

    def _read_only_by(self, index: int, user: int) -> bool:
        graph = self.typed.graph
        others = (k for k in graph.users[index] if not isinstance(graph.operations[k], SumOutside))
        return (
            set(others) == {user}
            and index not in graph.roots
            and self.start[user] == self.end[user] == self.end[index]
            and self._fraction(user) == self._fraction(index)
        )

    def _fraction(self, index: int) -> int:
        form = self.typed.formats[index]
        assert isinstance(form, Fixed)
        return form.fraction

    def _wire(self, index: int) -> Wire:
        if isinstance(self.typed, FloatGraph):
            return FromUnit(self.unit[index], 0) if index in self.unit else Own(index)
        if (carried := index if index in self.bus else self.guarded(index)) is not None:
            return OnBus(self.bus[carried], self._fraction(index))
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
