"""Which formats a search may choose: a variable for each signal, and for what has only a class."""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.explore.program import Code, Program
from kalmanhdl.numerics.specification import FixedSpecification, Form

_NAMED = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,31}\[\d{1,4}(,\d{1,4})?\]\Z")
_NOT_CHOSEN = ("bit", "constant", "nis")


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A width to choose. ``integer`` are the bits above the binary point, the sign included.

    Of a class (``signal`` is False) the binary point is placed for each of ``count`` values by its range.
    """

    name: str
    signal: bool
    slots: tuple[int, ...]
    integer: int
    signed: bool
    count: int = 1

    def form(self, width: int) -> Form:
        """The format of a width, as a specification has it."""
        if not self.signal:
            return width
        return Fixed(width=width, fraction=width - self.integer, signed=self.signed)


def variables_of(program: Program, extra: Mapping[str, int]) -> tuple[Variable, ...]:
    """The variables of the formats on which estimates depend, in a fixed order.

    ``extra`` gives signals bits above those that the ranges ask for.
    """
    named, classes = defaultdict[str, list[int]](list), defaultdict[str, list[int]](list)
    for index, slot in enumerate(program.slots):
        if index not in program.steering or slot.signal_class in _NOT_CHOSEN:
            continue
        if _NAMED.match(slot.name):
            named[slot.name].append(index)
        else:
            classes[slot.signal_class].append(index)
    found = []
    for name, slots in sorted(named.items()):
        signed = any(program.slots[k].signed for k in slots)
        integer = max(program.slots[k].integer for k in slots) + signed + extra.get(name, 0)
        found.append(Variable(name=name, signal=True, slots=tuple(slots), integer=integer, signed=signed))
    reciprocals = sum(step.code is Code.RECIPROCAL for step in program.steps)
    for name, slots in sorted(classes.items()):
        count = reciprocals if name == "reciprocal" else len(slots)
        found.append(
            Variable(name=name, signal=False, slots=tuple(slots), integer=0, signed=False, count=count)
        )
    return tuple(found)


def specification_of(
    base: FixedSpecification, variables: tuple[Variable, ...], widths: NDArray[np.int64]
) -> FixedSpecification:
    """The specification that gives every variable its width; what estimates do not rest on stays."""
    chosen = [(variable, variable.form(int(w))) for variable, w in zip(variables, widths, strict=True)]
    signals = {variable.name: form for variable, form in chosen if variable.signal}
    classes = {variable.name: form for variable, form in chosen if not variable.signal}
    return replace(base, signals=signals, classes=base.classes | classes)


def place_forms(
    forms: NDArray[np.void], program: Program, variables: tuple[Variable, ...], widths: NDArray[np.int64]
) -> NDArray[np.void]:
    """The formats of a program's slots under widths: ``FormatEngine.forms`` of their specification."""
    result = forms.copy()
    for variable, width in zip(variables, widths.tolist(), strict=True):
        for k in variable.slots:
            slot = program.slots[k]
            if variable.signal:
                less = variable.signed and not slot.signed
                result[k] = (max(1, width - less), width - variable.integer, slot.signed, True)
            else:
                result[k] = (width, width - slot.integer - slot.signed, slot.signed, False)
    return result


def bits_of(variables: tuple[Variable, ...], widths: NDArray[np.int64]) -> int:
    """The sum of the widths of all signals."""
    return int(sum(v.count * w for v, w in zip(variables, widths.tolist(), strict=True)))
