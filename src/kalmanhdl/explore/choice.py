"""Which formats a search may choose: a width for each signal, and for what has only a class."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.explore.program import Code, Program
from kalmanhdl.numerics.specification import SIGNAL, FixedSpecification

_NOT_CHOSEN = ("bit", "constant")


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A width to choose, of a signal or (``signal`` is False) of each of ``count`` values of a class.

    Its binary points are placed for each of ``slots`` by the range there, ``headroom`` bits above it.
    """

    name: str
    signal: bool
    slots: tuple[int, ...]
    count: int
    headroom: int

    def forms(self, program: Program, width: int) -> tuple[Fixed, ...]:
        """The formats that its values have at a width, each once; none where a divisor decides."""
        if self.name == "reciprocal":
            return ()
        found = dict.fromkeys(program.slots[k] for k in self.slots)
        above = ((slot.integer + slot.signed + self.headroom, slot.signed) for slot in found)
        formats = (Fixed(width=width, fraction=width - bits, signed=signed) for bits, signed in above)
        return tuple(dict.fromkeys(formats))


def variables_of(
    program: Program, headroom: Mapping[str, int], *, monitors: bool = False
) -> tuple[Variable, ...]:
    """The variables of the formats on which estimates depend, in a fixed order.

    ``headroom`` gives bits above those that the ranges ask for, by name. With ``monitors``, what only
    innovation and NIS depend on is chosen as well, and NIS itself, whose rounding moves its mean.
    """
    untouched = _NOT_CHOSEN if monitors else (*_NOT_CHOSEN, "nis")
    named, classes = defaultdict[str, list[int]](list), defaultdict[str, list[int]](list)
    for index, slot in enumerate(program.slots):
        if not (monitors or index in program.steering) or slot.signal_class in untouched:
            continue
        if SIGNAL.match(slot.name):
            named[slot.name].append(index)
        else:
            classes[slot.signal_class].append(index)
    reciprocals = sum(step.code is Code.RECIPROCAL for step in program.steps)
    counts = {name: reciprocals if name == "reciprocal" else len(slots) for name, slots in classes.items()}
    return tuple(
        Variable(
            name=name,
            signal=group is named,
            slots=tuple(slots),
            count=1 if group is named else counts[name],
            headroom=headroom.get(name, 0),
        )
        for group in (named, classes)
        for name, slots in sorted(group.items())
    )


def specification_of(
    base: FixedSpecification, variables: tuple[Variable, ...], widths: NDArray[np.int64]
) -> FixedSpecification:
    """The specification that gives every variable its width; what estimates do not rest on stays."""
    chosen = list(zip(variables, widths.tolist(), strict=True))
    signals = {variable.name: width for variable, width in chosen if variable.signal}
    classes = {variable.name: width for variable, width in chosen if not variable.signal}
    headroom = {variable.name: variable.headroom for variable in variables if variable.headroom}
    return replace(base, signals=signals, classes=base.classes | classes, headroom=headroom)


def place_forms(
    forms: NDArray[np.void], program: Program, variables: tuple[Variable, ...], widths: NDArray[np.int64]
) -> NDArray[np.void]:
    """The formats of a program's slots under widths: ``FormatEngine.forms`` of their specification."""
    result = forms.copy()
    for variable, width in zip(variables, widths.tolist(), strict=True):
        for k in variable.slots:
            slot = program.slots[k]
            fraction = width - slot.integer - slot.signed - variable.headroom
            result[k] = (width, fraction, slot.signed, False)
    return result


def bits_of(variables: tuple[Variable, ...], widths: NDArray[np.int64]) -> int:
    """The sum of the widths of all signals."""
    return int(sum(v.count * w for v, w in zip(variables, widths.tolist(), strict=True)))
