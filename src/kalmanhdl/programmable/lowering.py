"""From a typed graph to operations of units.

A word carries a number at a fraction that suits who reads it. Exact operations keep the real value, so that
their results may have more fraction bits than the typed graph says: the stage behind a unit appends zeros.
A quantisation becomes part of the operation whose result it takes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from kalmanhdl.errors import DesignError
from kalmanhdl.graph.operations import (
    Add,
    And,
    Constant,
    Flag,
    Graph,
    Input,
    Multiply,
    Negative,
    Not,
    Or,
    Outside,
    Quantise,
    Reciprocal,
    Select,
    Shift,
    State,
    Subtract,
)
from kalmanhdl.numerics.saturated import NAME as SATURATED
from kalmanhdl.numerics.typed import TypedGraph, Violation
from kalmanhdl.programmable.limits import Limits
from kalmanhdl.programmable.operations import (
    AddFunction,
    Fixture,
    Kept,
    Kind,
    Operation,
    Result,
    Stage,
    Step,
    Word,
)
from kalmanhdl.shape import Shape

_ZERO, _ONE = Fixture(0), Fixture(1)


def lowered(typed: TypedGraph, shape: Shape) -> Step:
    """A step in operations of the units of a shape.

    Raises:
        DesignError: an operation, an input, an output or a division that the shape has not.
        FormatError: a number that is wider than the shape's words, or is shifted further than it can be.
    """
    Limits(typed=typed, shape=shape).check_division()
    if Flag("initialise") not in typed.graph.operations:
        raise DesignError("a filter that nothing starts anew has no place on a programmable datapath")
    return _Lowering(typed, shape).step()


class _Lowering:
    """One pass from the roots of a graph down; keeps the word of every value at every fraction."""

    def __init__(self, typed: TypedGraph, shape: Shape) -> None:
        self._typed, self._graph, self._shape = typed, typed.graph, shape
        self._limits = Limits(typed=typed, shape=shape)
        self._operations: list[Operation] = []
        self._words: dict[tuple[int, int], Word] = {}
        self._flags: dict[int, Word] = {}
        self._computed: dict[tuple[int, Stage], Result] = {}
        # In the order in which they are met.
        self._read: dict[Kept, None] = {}
        # Violations that the operation of the quantisation itself watches, and all others.
        self._watched: dict[int, Violation] = {}
        self._gated: list[Violation] = []
        for violation in typed.violations:
            if isinstance(self._graph.operations[violation.outside], Outside) and isinstance(
                self._graph.operations[violation.quantise], Quantise
            ):
                self._watched[violation.quantise] = violation
            else:
                self._gated.append(violation)

    def step(self) -> Step:
        """The whole step."""
        outputs, states = self._outputs(), self._states()
        for violation in self._gated:
            self._watch(violation)
        return Step(operations=tuple(self._operations), states=states, outputs=outputs)

    def _states(self) -> dict[Kept, int]:
        """What is kept of states: those that are read, at the fractions at which they are."""
        operations, roots = self._graph.operations, dict(self._graph.states)
        own = {op.name: self._limits.fraction(k) for k, op in enumerate(operations) if isinstance(op, State)}
        for name, root in roots.items():
            if name != SATURATED and name not in own:
                # Nobody reads it, but what it would leave counts.
                self._word(root, self._limits.fraction(root))
        found: dict[Kept, int] = {}
        while waiting := [kept for kept in self._read if kept not in found]:
            for kept in waiting:
                root = roots[kept.state]
                word = self._word(root, own[kept.state] + kept.lift)
                found[kept] = self._alone(word, self._graph.origins[root], found)
        return found

    def _outputs(self) -> dict[str, int]:
        found: dict[str, int] = {}
        for name, root in self._graph.outputs:
            if name != SATURATED:
                self._limits.check_port(root, name, self._shape.outputs)
                word = self._word(root, self._limits.fraction(root))
                found[name] = self._alone(word, self._graph.origins[root], found)
        return found

    def _alone(self, word: Word, origin: str, taken: Mapping[Any, int]) -> int:
        """An operation that gives a word, and to none of those that took one before."""
        if isinstance(word, Result) and word.operation not in taken.values():
            return word.operation
        return self._added(origin, (word, _ZERO), self._plain(0)).operation

    def _emit(self, operation: Operation) -> Result:
        self._operations.append(operation)
        return Result(len(self._operations) - 1)

    def _added(
        self,
        origin: str,
        operands: tuple[Word, ...],
        stage: Stage,
        function: AddFunction = AddFunction.ADD,
    ) -> Result:
        return self._emit(
            Operation(kind=Kind.ADD, origin=origin, operands=operands, stage=stage, function=function)
        )

    def _plain(self, dropped: int) -> Stage:
        """The stage of a result that stays exact."""
        return Stage(dropped=dropped, width=self._shape.word_width)

    def _word(self, index: int, fraction: int) -> Word:
        """The value of an operation, exact, at a fraction no less than its own."""
        if (index, fraction) not in self._words:
            self._limits.check_word(index, fraction)
            self._words[index, fraction] = self._made(index, fraction)
        return self._words[index, fraction]

    def _made(self, index: int, fraction: int) -> Word:
        operation, own = self._graph.operations[index], self._limits.fraction(index)
        match operation:
            case Shift(a, exponent):
                return self._word(a, fraction + exponent)
            case Constant(value):
                raw = value * 2**fraction if fraction >= 0 else value / 2**-fraction
                assert raw.denominator == 1
                return Fixture(int(raw))
            case Add() | Subtract() | Multiply() | Select():
                return self._staged(index, self._plain(own - fraction))
            case State(name):
                kept = Kept(name, fraction - own)
                self._read[kept] = None
                return kept
            case _ if fraction != own:
                return self._staged(index, self._plain(own - fraction))
            case Quantise(a):
                return self._staged(a, self._stage_of(index, operation))
            case Input(name):
                self._limits.check_port(index, name, self._shape.inputs)
                return self._emit(Operation(kind=Kind.INPUT, origin=name, input=name))
            case Reciprocal(a):
                return self._reciprocal(index, a)
            case _:
                raise self._limits.unknown(index)

    def _stage_of(self, index: int, operation: Quantise) -> Stage:
        form = operation.form
        stage = Stage(
            dropped=self._limits.fraction(operation.a) - form.fraction,
            width=form.width,
            signed=form.signed,
            rounding=operation.rounding,
            overflow=operation.overflow,
        )
        return _watching(stage, self._watched[index]) if index in self._watched else stage

    def _staged(self, index: int, stage: Stage) -> Word:
        """What a stage makes of a value at its own fraction."""
        operation = self._graph.operations[index]
        if isinstance(operation, Shift):
            # The same raw integer, at another fraction.
            return self._staged(operation.a, stage)
        if (index, stage) not in self._computed:
            self._computed[index, stage] = self._on_unit(index, self._limits.checked(index, stage))
        return self._computed[index, stage]

    def _on_unit(self, index: int, stage: Stage) -> Result:
        operation, fraction = self._graph.operations[index], self._limits.fraction(index)
        origin = self._graph.origins[index]
        match operation:
            case Multiply(a, b):
                operands = self._factors(a, b)
                return self._emit(
                    Operation(kind=Kind.MULTIPLY, origin=origin, operands=operands, stage=stage)
                )
            case Add(a, b):
                return self._added(origin, (self._word(a, fraction), self._word(b, fraction)), stage)
            case Subtract(a, b):
                operands = self._word(a, fraction), self._word(b, fraction)
                return self._added(origin, operands, stage, AddFunction.SUBTRACT)
            case Select(flag, a, b):
                operands = self._word(a, fraction), self._word(b, fraction)
                return self._selected(origin, self._flag(flag), *operands, stage)
            case _:
                return self._added(origin, (self._word(index, fraction), _ZERO), stage)

    def _selected(self, origin: str, flag: Word, a: Word, b: Word, stage: Stage) -> Result:
        return self._added(origin, (a, b, flag), stage, AddFunction.SELECT)

    def _factors(self, a: int, b: int) -> tuple[Word, ...]:
        """The operands of a product, the wider one first."""
        limits, shape = self._limits, self._shape
        factors = sorted((a, b), key=lambda k: -limits.bits(k, limits.fraction(k)))
        rooms = shape.number_width, shape.operand_width
        for factor, room in zip(factors, rooms, strict=True):
            limits.check_width(
                factor, limits.fraction(factor), room, "operands of a multiplier", "operand_width"
            )
        return tuple(self._word(factor, limits.fraction(factor)) for factor in factors)

    def _reciprocal(self, index: int, a: int) -> Word:
        form, origin = self._typed.formats[index], self._graph.origins[index]
        assert form is not None
        exponent, dropped = self._limits.reciprocal(index, a)
        word = self._word(a, self._limits.fraction(a))
        quotient = self._emit(
            Operation(kind=Kind.RECIPROCAL, origin=origin, operands=(word,), exponent=exponent)
        )
        stage = Stage(
            dropped=dropped,
            width=form.width,
            signed=form.signed,
            rounding=self._typed.division_rounding,
        )
        return self._added(origin, (quotient, _ZERO), self._limits.staged(index, stage))

    def _flag(self, index: int) -> Word:
        """A flag as a word, 1 where it holds, else 0."""
        if index not in self._flags:
            self._flags[index] = self._made_flag(index)
        return self._flags[index]

    def _made_flag(self, index: int) -> Word:
        operation, origin = self._graph.operations[index], self._graph.origins[index]
        plain = self._plain(0)
        match operation:
            case Flag(name):
                self._limits.port(name, self._shape.inputs)
                return self._emit(Operation(kind=Kind.INPUT, origin=name, input=name))
            case And(a, b):
                return self._selected(origin, self._flag(a), self._flag(b), _ZERO, plain)
            case Or(a, b):
                return self._selected(origin, self._flag(a), _ONE, self._flag(b), plain)
            case Not(a):
                return self._selected(origin, self._flag(a), _ZERO, _ONE, plain)
            case Negative(a):
                word = self._word(a, self._limits.fraction(a))
                return self._added(origin, (word, _ZERO), plain, AddFunction.NEGATIVE)
            case _:
                raise self._limits.unknown(index)

    def _watch(self, violation: Violation) -> None:
        """An operation whose result nobody reads: only whether it leaves its format."""
        index, conditions = _conditions(self._graph, violation.outside)
        operation = self._graph.operations[index]
        if not isinstance(operation, Outside):
            raise self._limits.unknown(index)
        fraction, form = self._limits.fraction(operation.a), operation.form
        stage = Stage(
            dropped=fraction - form.fraction,
            width=form.width,
            signed=form.signed,
            rounding=operation.rounding,
        )
        stage = self._limits.checked(operation.a, _watching(stage, violation))
        if conditions:
            flag, word = self._all(conditions), self._word(operation.a, fraction)
            # Without its condition it is 0, which is in every format.
            self._selected(self._graph.origins[index], flag, word, _ZERO, stage)
        else:
            self._staged(operation.a, stage)

    def _all(self, conditions: Sequence[int]) -> Word:
        """The flag that all of some flags hold."""
        found = self._flag(conditions[0])
        for condition in conditions[1:]:
            origin = self._graph.origins[condition]
            found = self._selected(origin, self._flag(condition), found, _ZERO, self._plain(0))
        return found


def _conditions(graph: Graph, index: int) -> tuple[int, list[int]]:
    """The flag of a violation without the flags under which it counts, and these."""
    conditions: list[int] = []
    while isinstance(operation := graph.operations[index], And):
        first, second = operation.a, operation.b
        if not _holds_outside(graph, first):
            first, second = second, first
        conditions.append(second)
        index = first
    return index, conditions


def _holds_outside(graph: Graph, index: int) -> bool:
    operation = graph.operations[index]
    if isinstance(operation, And):
        return _holds_outside(graph, operation.a) or _holds_outside(graph, operation.b)
    return isinstance(operation, Outside)


def _watching(stage: Stage, violation: Violation) -> Stage:
    return replace(stage, watch_starting=violation.starting, watch_running=violation.running)
