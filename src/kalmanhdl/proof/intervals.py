"""Interval arithmetic of one step, with what is known of inputs, states and some values on the way."""

from collections.abc import Mapping

from kalmanhdl.graph.operations import (
    And,
    Flag,
    Input,
    Not,
    Or,
    Reciprocal,
    Select,
    State,
    is_flag,
)
from kalmanhdl.numerics.interval import Typed, aligned, reciprocal_interval, type_of
from kalmanhdl.numerics.typed import Interval, TypedGraph


def evaluate(
    typed: TypedGraph, known: Mapping[int, Interval], flags: Mapping[str, bool]
) -> list[Interval | None]:
    """The interval of every number of a step: within those of the typed graph, and within ``known`` ones.

    ``flags`` are the commands that are given; a choice by one of them has one branch.
    """
    found: list[Typed | None] = []
    decided: dict[int, bool] = {}
    for index, operation in enumerate(typed.graph.operations):
        if is_flag(operation):
            value = _flag(operation, decided, flags)
            if value is not None:
                decided[index] = value
            found.append(None)
            continue
        form, within = typed.formats[index], typed.intervals[index]
        assert form is not None
        assert within is not None
        if isinstance(operation, Select) and operation.flag in decided:
            chosen = operation.a if decided[operation.flag] else operation.b
            typed_chosen = found[chosen]
            assert typed_chosen is not None
            interval = aligned(typed_chosen[1], typed_chosen[0], form.fraction)
        elif isinstance(operation, Reciprocal):
            divisor = found[operation.a]
            assert divisor is not None
            interval = reciprocal_interval(divisor, form, typed.division_rounding, typed.division)
        else:
            _, interval = type_of(operation, found, form)  # type: ignore[arg-type]
        for other in (within, known.get(index)):
            interval = interval if other is None else _common(interval, other)
        found.append((form, interval))
    return [each and each[1] for each in found]


def leaves(typed: TypedGraph) -> dict[str, int]:
    """The places of inputs and states of numbers, by name."""
    return {op.name: k for k, op in enumerate(typed.graph.operations) if isinstance(op, Input | State)}


def _common(a: Interval, b: Interval) -> Interval:
    low, high = max(a.low, b.low), min(a.high, b.high)
    # Nothing is left only where the value is never taken.
    return Interval(low=low, high=high) if low <= high else b


def _flag(operation: object, decided: Mapping[int, bool], flags: Mapping[str, bool]) -> bool | None:
    match operation:
        case Flag(name):
            return flags.get(name)
        case Not(a) if a in decided:
            return not decided[a]
        case And(a, b):
            if decided.get(a) is False or decided.get(b) is False:
                return False
            return True if a in decided and b in decided else None
        case Or(a, b):
            if decided.get(a) is True or decided.get(b) is True:
                return True
            return False if a in decided and b in decided else None
        case _:
            return None
