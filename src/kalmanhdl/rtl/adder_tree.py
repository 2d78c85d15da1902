"""Sums of many shifted addends: a balanced tree of carry chains."""

from collections.abc import Sequence
from dataclasses import dataclass

from amaranth.hdl import Cat, Const, Module, Value

from kalmanhdl.rtl.shapes import shifted_sum
from kalmanhdl.rtl.stages import Stages, named


@dataclass(frozen=True, slots=True)
class Term:
    """The addend ``value << offset``."""

    offset: int
    value: Value

    @property
    def end(self) -> int:
        """The position above the last bit."""
        return self.offset + len(self.value)


def joined(terms: Sequence[Term]) -> list[Term]:
    """The same sum in fewer addends: one that begins above the end of another is set in front of it."""
    left = sorted(terms, key=lambda term: term.offset)
    result: list[Term] = []
    while left:
        term = left.pop(0)
        while not term.value.shape().signed:
            above = next((other for other in left if other.offset >= term.end), None)
            if above is None:
                break
            left.remove(above)
            value = Cat(term.value, Const(0, above.offset - term.end), above.value)
            term = Term(term.offset, value.as_signed() if above.value.shape().signed else value)
        result.append(term)
    return sorted(result, key=lambda term: term.offset)


def summed(
    m: Module, stages: Stages, first_step: int, terms: Sequence[Term], width: int
) -> tuple[Value, int]:
    """The sum of addends modulo 2**width, one step a level, and the step that follows."""
    step = first_step
    level = list(terms)
    while len(level) > 1:
        values = stages.before(step, {f"addend_{index}": term.value for index, term in enumerate(level)})
        level = [Term(term.offset, value) for term, value in zip(level, values.values(), strict=True)]
        odd = len(level) % 2
        pairs = zip(level[odd::2], level[odd + 1 :: 2], strict=True)
        level = level[:odd] + [
            Term(low.offset, named(m, f"sum_{step}_{index}", _added(low, high, width)))
            for index, (low, high) in enumerate(pairs)
        ]
        step += 1
    term = level[0]
    return term.value.shift_left(term.offset), step


def _added(low: Term, high: Term, width: int) -> Value:
    shift = high.offset - low.offset
    exact = max(len(low.value) + _sign_bit(low), len(high.value) + _sign_bit(high) + shift) + 1
    return shifted_sum(high.value, shift, low.value, min(exact, width - low.offset))


def _sign_bit(term: Term) -> int:
    return 0 if term.value.shape().signed else 1
