"""A graph of reals as operations whose formats are left open.

The same walk as ``numerics.quantise``, but every point where that may bring a value into a format becomes an
operation of its own, and every format a *slot* that is filled for each run. ``format_engine.c`` decides with
the formats at hand which of the points round. Where both differ:

* Functions (sine and the like) are rounded from their double; their circuits differ by a last bit.
* A product (1 - c) a, both operands unrounded, is a - c a in the hardware: equal values, other intervals, on
  which only depends whether an operand of a constant multiplication is rounded.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from fractions import Fraction

from kalmanhdl.explore.slots import Slot, slot_of
from kalmanhdl.graph.operations import (
    Add,
    And,
    Binary,
    Constant,
    Divide,
    Flag,
    Function,
    Graph,
    Input,
    Multiply,
    Negative,
    Not,
    Operation,
    Or,
    Reciprocal,
    Select,
    Shift,
    State,
    Subtract,
    Table,
    Unary,
)
from kalmanhdl.numerics.ranges import Ranges
from kalmanhdl.numerics.signals import SignalName, signal_of

_TINY = 2.0**-64
_OF_POINTS = (Function.ARCTANGENT, Function.HYPOTENUSE)
STARTING, RUNNING = 1, 2


class Code(IntEnum):
    """The operations of ``format_engine.c``, in its order."""

    INPUT = 0
    STATE = 1
    FLAG = 2
    CONSTANT = 3
    ROUNDED = 4
    BESIDE = 5
    ADD = 6
    SUBTRACT = 7
    MULTIPLY = 8
    SCALE = 9
    SHIFT = 10
    NEAR = 11
    QUOTIENT = 12
    FORM = 13
    QUANTISE = 14
    RECIPROCAL = 15
    DIVIDE = 16
    FUNCTION = 17
    TABLE = 18
    SELECT = 19
    NEGATIVE = 20
    AND = 21
    OR = 22
    NOT = 23


_KNOWN = (Code.CONSTANT, Code.ROUNDED, Code.BESIDE)
_ZERO = Fraction(0)


@dataclass(frozen=True, slots=True)
class Step:
    """One operation: operands a, b, c by index (or what ``code`` reads there), and its slot.

    ``value`` is a constant's, or the least divisor seen of a reciprocal.
    """

    code: Code
    a: int = 0
    b: int = 0
    c: int = 0
    slot: int = 0
    value: Fraction = _ZERO


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Program:
    """The operations of a step, its slots, and what enters, stays and leaves.

    ``matters[k]`` has the bits ``STARTING`` and ``RUNNING``: in which steps a value is of use. ``steering``
    are the slots on which state estimates depend, and not only innovation and NIS.
    """

    steps: tuple[Step, ...]
    slots: tuple[Slot, ...]
    tables: tuple[tuple[Fraction, ...], ...]
    inputs: tuple[str, ...]
    flags: tuple[str, ...]
    states: tuple[tuple[str, int, int], ...]
    outputs: tuple[tuple[str, int], ...]
    matters: tuple[int, ...]
    steering: frozenset[int]


def program_of(graph: Graph, ranges: Ranges) -> Program:
    """The program of a graph of reals whose operations take values within ``ranges``."""
    return _Assembler(graph, ranges).assembled()


class _Assembler:
    """One pass over a graph; keeps for every operation the step that has its exact value."""

    def __init__(self, graph: Graph, ranges: Ranges) -> None:
        self.graph, self.ranges = graph, ranges
        self.steps: list[Step] = []
        self.slots: list[Slot] = []
        self.tables: list[tuple[Fraction, ...]] = []
        self.inputs: list[str] = []
        self.flags: list[str] = []
        self.leaves: dict[str, int] = {}
        self._index: dict[Step, int] = {}
        self._slot_index: dict[Slot, int] = {}
        self.exact: list[int] = []
        for index, operation in enumerate(graph.operations):
            self.exact.append(self._assemble(index, operation))

    def assembled(self) -> Program:
        """The program, with the new values of states in their formats."""
        roots = {name: self._state(name, root) for name, root in self.graph.states}
        states = tuple((name, self.leaves[name], root) for name, root in roots.items())
        outputs = tuple((name, roots.get(name, -1)) for name, _ in self.graph.outputs)
        outputs = tuple(
            (name, self._own(index) if root < 0 else root)
            for (name, root), (_, index) in zip(outputs, self.graph.outputs, strict=True)
        )
        ends = [root for _, _, root in states] + [root for _, root in outputs]
        starting, running = (_cone(self, ends, initialise) for initialise in (True, False))
        estimates = [root for name, root in outputs if name.startswith("x[")]
        needed = _reached(self, [root for _, _, root in states] + estimates)
        return Program(
            steps=tuple(self.steps),
            slots=tuple(self.slots),
            tables=tuple(self.tables),
            inputs=tuple(self.inputs),
            flags=tuple(self.flags),
            states=states,
            outputs=outputs,
            matters=tuple(
                STARTING * (k in starting) + RUNNING * (k in running) for k in range(len(self.steps))
            ),
            steering=frozenset(self.steps[k].slot for k in needed if _has_slot(self.steps[k].code)),
        )

    def _emit(
        self, code: Code, a: int = 0, b: int = 0, c: int = 0, slot: int = 0, value: Fraction = _ZERO
    ) -> int:
        step = Step(code, a, b, c, slot, value)
        if step not in self._index:
            self._index[step] = len(self.steps)
            self.steps.append(step)
        return self._index[step]

    def _slot(self, slot: Slot) -> int:
        if slot not in self._slot_index:
            self._slot_index[slot] = len(self.slots)
            self.slots.append(slot)
        return self._slot_index[slot]

    def _form(self, index: int, signal: SignalName, unsigned: bool = False) -> int:
        return self._slot(slot_of(self.graph, self.ranges, index, signal, unsigned=unsigned))

    def _assemble(self, index: int, operation: Operation) -> int:
        match operation:
            case Input(name):
                self.inputs.append(name)
                return self._emit(
                    Code.INPUT, len(self.inputs) - 1, slot=self._form(index, self._signal(index, name))
                )
            case State(name):
                slot = self._form(index, self._signal(index, name))
                self.leaves[name] = self._emit(Code.STATE, len(self.leaves), slot=slot)
                return self.leaves[name]
            case Flag(name):
                self.flags.append(name)
                return self._emit(Code.FLAG, len(self.flags) - 1)
            case Constant(value):
                return self._emit(Code.CONSTANT, value=value)
            case Add(a, b):
                x, y = self._addends(a, b)
                if self._is_zero(x) or self._is_zero(y):
                    return y if self._is_zero(x) else x
                return self._emit(Code.ADD, x, y)
            case Subtract(a, b):
                x, y = self._addends(a, b)
                return x if self._is_zero(y) else self._emit(Code.SUBTRACT, x, y)
            case Multiply(a, b):
                factor = self.steps[self.exact[a]]
                if factor.code is Code.CONSTANT:
                    return self._emit(Code.SCALE, self._near(b), slot=self._width(), value=factor.value)
                return self._emit(Code.MULTIPLY, self._narrow(a), self._narrow(b))
            case Shift(a, exponent):
                return self._emit(Code.SHIFT, self._own(a), c=exponent)
            case Reciprocal(a):
                return self._reciprocal(self._divisor(a), max(self.ranges.low[a], _TINY))
            case Divide(a, b):
                return self._quotient(index, a, b)
            case Unary(function, a):
                return self._function(index, function, a, a)
            case Binary(function, a, b):
                return self._function(index, function, a, b)
            case Table(a, rows):
                return self._row(index, a, rows)
            case Select(flag, a, b):
                return self._emit(Code.SELECT, self.exact[flag], *self._addends(a, b))
            case Negative(a):
                return self._emit(Code.NEGATIVE, self.exact[a])
            case And(a, b):
                return self._emit(Code.AND, self.exact[a], self.exact[b])
            case Or(a, b):
                return self._emit(Code.OR, self.exact[a], self.exact[b])
            case Not(a):
                return self._emit(Code.NOT, self.exact[a])
            case _:
                raise AssertionError(f"{operation} in a graph of reals")

    def _signal(self, index: int, leaf: str = "") -> SignalName:
        if isinstance(self.graph.operations[index], Reciprocal):
            return SignalName(name="", signal_class="reciprocal", unsigned=True, own_format=True)
        return signal_of(leaf or self.graph.origins[index])

    def _is_known(self, step: int) -> bool:
        found = self.steps[step]
        return found.code in _KNOWN or (found.code is Code.QUANTISE and self._is_known(found.a))

    def _is_zero(self, step: int) -> bool:
        return self.steps[step].code is Code.CONSTANT and self.steps[step].value == 0

    def _is_flag(self, step: int) -> bool:
        return self.steps[step].code in (Code.FLAG, Code.NEGATIVE, Code.AND, Code.OR, Code.NOT)

    def _own(self, index: int) -> int:
        exact = self.exact[index]
        if self._is_known(exact) or self._is_flag(exact):
            return exact
        return self._narrow(index) if signal_of(self.graph.origins[index]).own_format else exact

    def _narrow(self, index: int) -> int:
        exact = self.exact[index]
        if self._is_known(exact) or isinstance(self.graph.operations[index], Reciprocal):
            return exact
        return self._fitted(exact, self._form(index, self._signal(index)))

    def _near(self, index: int) -> int:
        own, narrow = self._own(index), self._narrow(index)
        slot = self._form(index, self._signal(index))
        return own if own == narrow else self._emit(Code.NEAR, own, narrow, slot=slot)

    def _divisor(self, index: int) -> int:
        return self._fitted(self._own(index), self._form(index, self._signal(index), unsigned=True))

    def _fitted(self, value: int, slot: int, as_it_is: bool = False) -> int:
        form = self._emit(Code.FORM, value, c=as_it_is, slot=slot)
        return self._pushed(value, form, slot)

    def _pushed(self, value: int, form: int, slot: int) -> int:
        """The value in a format; choices are made after it, and constants are known in it."""
        step = self.steps[value]
        if step.code is Code.SELECT:
            return self._emit(
                Code.SELECT, step.a, self._pushed(step.b, form, slot), self._pushed(step.c, form, slot)
            )
        return self._emit(Code.QUANTISE, value, form, slot=slot)

    def _addends(self, a: int, b: int) -> tuple[int, int]:
        x, y = self._own(a), self._own(b)
        return self._beside(x, y), self._beside(y, x)

    def _beside(self, value: int, other: int) -> int:
        if not self._is_known(value) or self._is_zero(value):
            return value
        step = self.steps[value]
        assert step.code is Code.CONSTANT, f"{step} beside another value"
        rounded = self._emit(Code.ROUNDED, slot=self._width(), value=step.value)
        return rounded if self._is_known(other) else self._emit(Code.BESIDE, rounded, other)

    def _width(self) -> int:
        return self._slot(Slot(name="", signal_class="constant", signed=True, greatest=0.0))

    def _reciprocal(self, divisor: int, least: float) -> int:
        slot = self._slot(Slot(name="", signal_class="reciprocal", signed=False, greatest=0.0))
        for index, step in enumerate(self.steps):
            if step.code is Code.RECIPROCAL and step.a == divisor:
                return index
        return self._emit(Code.RECIPROCAL, divisor, slot=slot, value=Fraction(least))

    def _quotient(self, index: int, a: int, b: int) -> int:
        """By the reciprocal where the divisor may come near zero, which the engine decides."""
        divisor, dividend = self._divisor(b), self._narrow(a)
        reciprocal = self._reciprocal(divisor, max(abs(self.ranges.low[b]), _TINY))
        product = self._emit(Code.MULTIPLY, dividend, reciprocal)
        quotient = self._emit(Code.DIVIDE, dividend, divisor, slot=self._form(index, self._signal(index)))
        return self._emit(Code.QUOTIENT, product, quotient, divisor)

    def _function(self, index: int, function: Function, a: int, b: int) -> int:
        near = self._near if function in _OF_POINTS else self._own
        slot = self._form(index, self._signal(index))
        return self._emit(Code.FUNCTION, near(a), near(b), list(Function).index(function), slot)

    def _row(self, index: int, a: int, rows: tuple[Fraction, ...]) -> int:
        slot = self._form(index, self._signal(index))
        number = self._slot(Slot.of_numbers(len(rows)))
        place = self._fitted(self._own(a), number, as_it_is=True)
        self.tables.append(rows)
        return self._emit(Code.TABLE, place, len(self.tables) - 1, slot=slot)

    def _state(self, name: str, root: int) -> int:
        slot = self.steps[self.leaves[name]].slot
        return self._fitted(self.exact[root], slot, as_it_is=True)


def _has_slot(code: Code) -> bool:
    return code in (
        Code.INPUT,
        Code.STATE,
        Code.SCALE,
        Code.ROUNDED,
        Code.QUANTISE,
        Code.RECIPROCAL,
        Code.DIVIDE,
        Code.FUNCTION,
        Code.TABLE,
    )


def operand_steps(step: Step) -> tuple[int, ...]:
    """The steps whose values a step reads."""
    match step.code:
        case Code.INPUT | Code.STATE | Code.FLAG | Code.CONSTANT | Code.ROUNDED:
            return ()
        case Code.SCALE | Code.SHIFT | Code.FORM | Code.QUANTISE | Code.RECIPROCAL:
            return (step.a,)
        case Code.TABLE | Code.NEGATIVE | Code.NOT | Code.BESIDE:
            return (step.a,)
        case Code.SELECT | Code.QUOTIENT:
            return (step.a, step.b, step.c)
        case _:
            return (step.a, step.b)


def _reached(assembler: _Assembler, ends: Iterable[int]) -> set[int]:
    seen: set[int] = set()
    stack = list(ends)
    while stack:
        index = stack.pop()
        if index not in seen:
            seen.add(index)
            stack.extend(operand_steps(assembler.steps[index]))
    return seen


def _cone(assembler: _Assembler, ends: Iterable[int], initialise: bool) -> set[int]:
    """The steps that states and outputs depend on when the command is known."""
    known = _known_flags(assembler, initialise)
    seen: set[int] = set()
    stack = list(ends)
    while stack:
        index = stack.pop()
        if index in seen:
            continue
        seen.add(index)
        step = assembler.steps[index]
        if step.code is Code.SELECT and step.a in known:
            stack.append(step.b if known[step.a] else step.c)
        else:
            stack.extend(operand_steps(step))
    return seen


def _known_flags(assembler: _Assembler, initialise: bool) -> dict[int, bool]:
    known: dict[int, bool] = {}
    for index, step in enumerate(assembler.steps):
        match step.code:
            case Code.FLAG if assembler.flags[step.a] == "initialise":
                known[index] = initialise
            case Code.NOT if step.a in known:
                known[index] = not known[step.a]
            case Code.AND if known.get(step.a) is False or known.get(step.b) is False:
                known[index] = False
            case Code.OR if known.get(step.a) is True or known.get(step.b) is True:
                known[index] = True
            case _:
                pass
    return known
