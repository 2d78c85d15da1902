"""Expressions in strings: numbers such as ``"pi/90"``, and formulas in variables such as ``"x + T*vx"``.

A small recursive-descent parser over floats and Signals; nothing is handed to the interpreter.

    sum     = product {("+" | "-") product}
    product = factor {("*" | "/") factor}
    factor  = ("+" | "-") factor | power
    power   = atom [("^" | "**") factor]
    atom    = number | name | function "(" sum {"," sum} ")" | "(" sum ")"
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar

from kalmanhdl import math as elementwise
from kalmanhdl.errors import DesignError
from kalmanhdl.graph.signal import Scalar, Signal
from kalmanhdl.validation import nearest, shown

MAX_LENGTH = 200
MAX_FORMULA = 5000
MAX_DEPTH = 32
MAX_EXPONENT = 32
MAX_CONSTANTS = 256

_Value = TypeVar("_Value", float, float | Signal)

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<sign>\*\*|[-+*/^(),]))"
)


@dataclass(frozen=True, slots=True)
class _Function:
    """A function of numbers, and the same over Signals, where there is one."""

    count: int
    number: Callable[..., float]
    signal: Callable[..., Any] | None


def _tangent(angle: Scalar) -> Any:
    return elementwise.sin(angle) / elementwise.cos(angle)


def _wrap(angle: float) -> float:
    return float(elementwise.wrap(angle))


_FUNCTIONS: Mapping[str, _Function] = MappingProxyType(
    {
        "sqrt": _Function(1, math.sqrt, elementwise.sqrt),
        "exp": _Function(1, math.exp, elementwise.exp),
        "log": _Function(1, math.log, None),
        "sin": _Function(1, math.sin, elementwise.sin),
        "cos": _Function(1, math.cos, elementwise.cos),
        "tan": _Function(1, math.tan, _tangent),
        "wrap": _Function(1, _wrap, elementwise.wrap),
        "atan2": _Function(2, math.atan2, elementwise.atan2),
        "hypot": _Function(2, math.hypot, elementwise.hypot),
    }
)
_NUMBERS: Mapping[str, float] = MappingProxyType({"pi": math.pi, "e": math.e})

RESERVED = frozenset((*_FUNCTIONS, *_NUMBERS))
"""The names that a constant may not take."""


class ExpressionError(DesignError):
    """A text is no expression. The message leaves the place to the caller."""


def evaluate(text: str, constants: Mapping[str, float]) -> float:
    """The finite value of an expression.

    Raises:
        DesignError: the text is no expression, too long or too deep, names an unknown constant, or has
            no finite real value.
    """
    return float(_evaluate(text, lambda name: _lookup(name, constants)))


def formula(text: str, values: Mapping[str, float | Signal]) -> float | Signal:
    """What an expression in variables comes to, where a name is a number or a Signal.

    Raises:
        DesignError: as ``evaluate``; also a function or a power that is not there for variables.
    """
    value: float | Signal = _evaluate(text, lambda name: _lookup(name, values), MAX_FORMULA)
    return value


def resolve(table: Mapping[str, float | str]) -> dict[str, float]:
    """The constants of a table, whose expressions may name each other in any order.

    Raises:
        DesignError: as ``evaluate``; also a cycle. The message begins with the constant's name.
    """
    if len(table) > MAX_CONSTANTS:
        raise ExpressionError(f"{len(table)} constants: at most {MAX_CONSTANTS}")
    values: dict[str, float] = {}
    open_names: list[str] = []

    def value_of(name: str) -> float:
        if name in values or name not in table:
            return _lookup(name, {**dict.fromkeys(table, 0.0), **values})
        if name in open_names:
            cycle = " -> ".join([*open_names[open_names.index(name) :], name])
            raise ExpressionError(f"the constants refer to each other in a cycle: {cycle}")
        if len(open_names) > MAX_DEPTH:
            raise ExpressionError(f"more than {MAX_DEPTH} constants refer to each other in a chain")
        open_names.append(name)
        entry = table[name]
        values[name] = _evaluate(entry, value_of) if isinstance(entry, str) else entry
        open_names.pop()
        return values[name]

    for name in table:
        try:
            value_of(name)
        except ExpressionError as error:
            raise ExpressionError(f"{name}: {error}") from None
    return {name: values[name] for name in table}


def _lookup(name: str, constants: Mapping[str, _Value]) -> _Value | float:
    if name in constants:
        return constants[name]
    if name in _NUMBERS:
        return _NUMBERS[name]
    if name in _FUNCTIONS:
        raise ExpressionError(f"the function {name} needs its argument in parentheses")
    hint = nearest(name, (*constants, *_NUMBERS, *_FUNCTIONS))
    raise ExpressionError(f"the name {shown(name)} is unknown: {hint}")


def _evaluate(text: str, lookup: Callable[[str], Any], longest: int = MAX_LENGTH) -> Any:
    if len(text) > longest:
        raise ExpressionError(f"{len(text)} characters: an expression has at most {longest}")
    parser = _Parser(_tokens(text), lookup)
    try:
        value = parser.sum()
    except OverflowError:
        raise ExpressionError(f"{shown(text)} is too large for a number") from None
    except (ValueError, ZeroDivisionError):
        raise ExpressionError(f"{shown(text)} has no real value") from None
    if parser.here < len(parser.tokens):
        raise ExpressionError(f"{shown(text)}: {shown(parser.tokens[parser.here])} is not expected here")
    if not isinstance(value, Signal) and not math.isfinite(value):
        raise ExpressionError(f"{shown(text)} is too large for a number")
    return value


def _tokens(text: str) -> list[str]:
    tokens, here, end = [], 0, len(text.rstrip())
    while here < end:
        match = _TOKEN.match(text, here)
        if match is None:
            rest = text[here:].lstrip()
            raise ExpressionError(f"{shown(text)}: {rest[0]!r} belongs to no expression")
        tokens.append(match[match.lastgroup or 0])
        here = match.end()
    return tokens


def _power(base: Any, exponent: Any) -> Any:
    if not isinstance(base, Signal) and not isinstance(exponent, Signal):
        return math.pow(base, exponent)
    # Twice an exponent of halves is whole.
    halves = None if isinstance(exponent, Signal) else exponent * 2
    if halves is None or not isinstance(base, Signal) or halves != int(halves) or abs(halves) > MAX_EXPONENT:
        raise ExpressionError("the power of a variable is a small number such as 2, -1 or 0.5")
    if halves % 2:
        return _power(elementwise.sqrt(base), halves)
    return base ** int(exponent) if exponent else 1.0


@dataclass(slots=True)
class _Parser:
    """Evaluates while it reads; ``here`` is the next token."""

    tokens: list[str]
    lookup: Callable[[str], Any]
    here: int = 0
    depth: int = 0

    def sum(self) -> Any:
        value = self.product()
        while self.next_is("+", "-"):
            value = value + self.product() if self.take() == "+" else value - self.product()
        return value

    def product(self) -> Any:
        value = self.factor()
        while self.next_is("*", "/"):
            value = value * self.factor() if self.take() == "*" else value / self.factor()
        return value

    def factor(self) -> Any:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise ExpressionError(f"nested deeper than {MAX_DEPTH}")
        if self.next_is("-", "+"):
            value = -self.factor() if self.take() == "-" else self.factor()
        else:
            value = self.power()
        self.depth -= 1
        return value

    def power(self) -> Any:
        base = self.atom()
        if self.next_is("^", "**"):
            self.take()
            return _power(base, self.factor())
        return base

    def atom(self) -> Any:
        token = self.take()
        if token == "(":
            value = self.sum()
            self.expect(")")
            return value
        if token[0].isdigit() or token[0] == ".":
            return float(token)
        if token[0].isalpha() or token[0] == "_":
            return self.call(token) if self.next_is("(") else self.lookup(token)
        raise ExpressionError(f"{token!r} is not expected here: a number, a name or '(' is")

    def call(self, name: str) -> Any:
        if name not in _FUNCTIONS:
            raise ExpressionError(f"the function {shown(name)} is unknown: {nearest(name, _FUNCTIONS)}")
        function = _FUNCTIONS[name]
        count = function.count
        self.take()
        arguments = [self.sum()]
        while self.next_is(","):
            self.take()
            arguments.append(self.sum())
        self.expect(")")
        if len(arguments) != count:
            raise ExpressionError(f"{name} takes {count} argument{'s' * (count > 1)}, not {len(arguments)}")
        if not any(isinstance(argument, Signal) for argument in arguments):
            return function.number(*arguments)
        if function.signal is None:
            raise ExpressionError(f"{name} takes numbers only, not what varies from step to step")
        return function.signal(*arguments)

    def next_is(self, *tokens: str) -> bool:
        return self.here < len(self.tokens) and self.tokens[self.here] in tokens

    def take(self) -> str:
        if self.here >= len(self.tokens):
            raise ExpressionError("ends too early: a number, a name or '(' is expected")
        self.here += 1
        return self.tokens[self.here - 1]

    def expect(self, token: str) -> None:
        if not self.next_is(token):
            raise ExpressionError(f"{token!r} is missing")
        self.here += 1
