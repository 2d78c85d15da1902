"""How a multiply-add unit places the products of its sums, and how wide it sums.

Every sum stands in the unit so that the last bit of its format has the same place, with ``dropped`` bits
below: products come to their place by a shift, and every sum is rounded at the same bit.
"""

from dataclasses import dataclass

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.graph.operations import Product, SumOfProducts
from kalmanhdl.numerics.typed import TypedGraph


@dataclass(frozen=True, slots=True)
class Mode:
    """How a sum, a raw integer, is quantised."""

    width: int
    signed: bool
    rounding: Rounding
    overflow: Overflow


@dataclass(frozen=True, slots=True, kw_only=True)
class Accumulator:
    """A signed sum of ``width`` bits. Products come shifted left by up to ``lifts`` bits."""

    width: int
    dropped: int
    lifts: int
    modes: tuple[Mode, ...]

    @property
    def rounds(self) -> bool:
        """Whether any quantisation does more than drop bits."""
        return any(mode.rounding is not Rounding.FLOOR for mode in self.modes)


def accumulator(typed: TypedGraph, who: tuple[int, ...]) -> Accumulator:
    """The accumulator on which these sums of products can be computed."""
    sums = [operation for k in who if isinstance(operation := typed.graph.operations[k], SumOfProducts)]
    dropped = max(0, *(finer(typed, one, term) for one in sums for term in one.terms))
    largest = max(_largest(typed, one, dropped) for one in sums)
    return Accumulator(
        width=largest.bit_length() + 1,
        dropped=dropped,
        lifts=max(dropped - finer(typed, one, term) for one in sums for term in one.terms),
        modes=tuple(dict.fromkeys(map(mode, sums))),
    )


def mode(operation: SumOfProducts) -> Mode:
    """How a sum is quantised."""
    form = operation.form
    return Mode(form.width, form.signed, operation.rounding, operation.overflow)


def finer(typed: TypedGraph, operation: SumOfProducts, term: Product) -> int:
    """By how many bits a product is finer than the format of its sum."""
    return _form(typed, term.a).fraction + _form(typed, term.b).fraction - operation.form.fraction


def _largest(typed: TypedGraph, operation: SumOfProducts, dropped: int) -> int:
    """No sum of some of the products is further from zero."""
    return sum(
        _magnitude(typed, term.a) * _magnitude(typed, term.b) << dropped - finer(typed, operation, term)
        for term in operation.terms
    )


def _magnitude(typed: TypedGraph, index: int) -> int:
    interval = typed.intervals[index]
    assert interval is not None
    return max(abs(interval.low), abs(interval.high))


def _form(typed: TypedGraph, index: int) -> Fixed:
    form = typed.formats[index]
    assert form is not None
    return form
