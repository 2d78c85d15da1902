"""Formats left open: what a format depends on besides the width that is asked for."""

import math
from dataclasses import dataclass

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.operations import Binary, Graph, Table, Unary
from kalmanhdl.numerics.functions.lowering import REACH
from kalmanhdl.numerics.quantise import margin
from kalmanhdl.numerics.ranges import Ranges
from kalmanhdl.numerics.signals import SignalName
from kalmanhdl.numerics.specification import FixedSpecification


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """A format to be chosen, of a signal or of what has only a class.

    ``greatest`` is how far its values reach with margin. ``fixed`` is the format where there is no choice.
    """

    name: str
    signal_class: str
    signed: bool
    greatest: float
    fixed: Fixed | None = None

    @property
    def integer(self) -> int:
        """Bits above the binary point, without the sign."""
        return math.frexp(self.greatest)[1] if self.greatest else 0

    @staticmethod
    def of_numbers(rows: int) -> "Slot":
        """Of the number of a row."""
        form = Fixed(width=max(1, (rows - 1).bit_length()), fraction=0, signed=False)
        return Slot(name="", signal_class="bit", signed=False, greatest=0.0, fixed=form)

    def chosen(self, specification: FixedSpecification) -> tuple[Fixed, bool]:
        """The format under a specification, and whether that gives it whole."""
        if self.fixed is not None:
            return self.fixed, False
        wanted = specification.form(self.signal_class, self.name or None)
        if isinstance(wanted, Fixed):
            unsigned = wanted.signed and not self.signed and self.signal_class != "reciprocal"
            return (_unsigned(wanted) if unsigned else wanted), True
        above = self.integer + specification.room(self.signal_class, self.name or None) + self.signed
        form = Fixed(width=wanted, fraction=wanted - above, signed=self.signed)
        return form, False


def slot_of(graph: Graph, ranges: Ranges, index: int, signal: SignalName, *, unsigned: bool) -> Slot:
    """The slot of an operation's value, as ``numerics.quantise`` gives it a format."""
    if signal.signal_class == "bit":
        form = Fixed(width=1, fraction=0, signed=False)
        return Slot(name=signal.name, signal_class="bit", signed=False, greatest=0.0, fixed=form)
    greatest = max(abs(ranges.low[index]), abs(ranges.high[index])) * margin(
        ranges, index, signal.signal_class
    )
    operation = graph.operations[index]
    if isinstance(operation, Table):
        greatest = float(max(map(abs, operation.rows)))
    if isinstance(operation, Unary | Binary):
        greatest = min(greatest, REACH.get(operation.function, greatest))
    return Slot(
        name=signal.name,
        signal_class=signal.signal_class,
        signed=not (unsigned or signal.unsigned or ranges.never_negative(index)),
        greatest=greatest,
    )


def _unsigned(form: Fixed) -> Fixed:
    return Fixed(width=max(1, form.width - 1), fraction=form.fraction, signed=False)
