"""Sums of many shifted addends: a balanced tree of carry chains."""

from collections.abc import Sequence
from dataclasses import dataclass

from amaranth.hdl import Cat, Const, Module, Value

from kalmanhdl.arithmetic.product_structure import joined, tree_levels
from kalmanhdl.rtl.shapes import shifted_sum
from kalmanhdl.rtl.stages import Stages, named


@dataclass(frozen=True, slots=True)
class Term:
    """The addend ``value << offset``."""

    offset: int
    value: Value


def joined_terms(terms: Sequence[Term]) -> list[Term]:
    """The same sum in fewer addends: one that begins above the end of another is set in front of it."""
    spans = [(term.offset, term.offset + len(term.value), term.value.shape().signed) for term in terms]
    return [_chained([terms[index] for index in group]) for group in joined(spans)]


def _chained(terms: Sequence[Term]) -> Term:
    parts: list[Value] = []
    end = terms[0].offset
    for term in terms:
        parts += [Const(0, term.offset - end), term.value]
        end = term.offset + len(term.value)
    value = Cat(*parts)
    return Term(terms[0].offset, value.as_signed() if terms[-1].value.shape().signed else value)


def summed(
    m: Module, stages: Stages, first_step: int, terms: Sequence[Term], width: int, carried: dict[str, Value]
) -> tuple[Value, dict[str, Value]]:
    """The sum of addends modulo 2**width, as many steps as there are levels.

    ``carried`` values go along through the registers; they return beside the sum.
    """
    level = sorted(terms, key=lambda term: term.offset)
    for step in range(first_step, first_step + tree_levels(len(terms))):
        addends = {f"addend_{index}": term.value for index, term in enumerate(level)}
        values = stages.before(step, addends | carried)
        carried = {name: values[name] for name in carried}
        level = [Term(term.offset, values[name]) for term, name in zip(level, addends, strict=True)]
        odd = len(level) % 2
        pairs = zip(level[odd::2], level[odd + 1 :: 2], strict=True)
        level = level[:odd] + [
            Term(low.offset, named(m, f"sum_{step}_{index}", _added(low, high, width)))
            for index, (low, high) in enumerate(pairs)
        ]
    return level[0].value.shift_left(level[0].offset), carried


def _added(low: Term, high: Term, width: int) -> Value:
    shift = high.offset - low.offset
    exact = max(len(low.value) + _sign_bit(low), len(high.value) + _sign_bit(high) + shift) + 1
    return shifted_sum(high.value, shift, low.value, min(exact, width - low.offset))


def _sign_bit(term: Term) -> int:
    return 0 if term.value.shape().signed else 1
