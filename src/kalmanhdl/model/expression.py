"""Numbers written as expressions: ``"pi/90"``, ``"T^2/2"``, ``"sqrt(2) * sigma"``.

A small recursive-descent parser over floats; nothing is handed to the interpreter.

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

from kalmanhdl.errors import DesignError
from kalmanhdl.validation import nearest, shown

MAX_LENGTH = 200
MAX_DEPTH = 32
MAX_CONSTANTS = 256

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<sign>\*\*|[-+*/^(),]))"
)

_FUNCTIONS: Mapping[str, tuple[int, Callable[..., float]]] = MappingProxyType(
    {
        "sqrt": (1, math.sqrt),
        "exp": (1, math.exp),
        "log": (1, math.log),
        "sin": (1, math.sin),
        "cos": (1, math.cos),
        "tan": (1, math.tan),
        "atan2": (2, math.atan2),
        "hypot": (2, math.hypot),
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
    return _evaluate(text, lambda name: _lookup(name, constants))


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


def _lookup(name: str, constants: Mapping[str, float]) -> float:
    if name in constants:
        return constants[name]
    if name in _NUMBERS:
        return _NUMBERS[name]
    if name in _FUNCTIONS:
        raise ExpressionError(f"the function {name} needs its argument in parentheses")
    hint = nearest(name, (*constants, *_NUMBERS, *_FUNCTIONS))
    raise ExpressionError(f"the name {shown(name)} is unknown: {hint}")


def _evaluate(text: str, lookup: Callable[[str], float]) -> float:
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"{len(text)} characters: an expression has at most {MAX_LENGTH}")
    parser = _Parser(_tokens(text), lookup)
    try:
        value = parser.sum()
    except OverflowError:
        raise ExpressionError(f"{shown(text)} is too large for a number") from None
    except (ValueError, ZeroDivisionError):
        raise ExpressionError(f"{shown(text)} has no real value") from None
    if parser.here < len(parser.tokens):
        raise ExpressionError(f"{shown(text)}: {shown(parser.tokens[parser.here])} is not expected here")
    if not math.isfinite(value):
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


@dataclass(slots=True)
class _Parser:
    """Evaluates while it reads; ``here`` is the next token."""

    tokens: list[str]
    lookup: Callable[[str], float]
    here: int = 0
    depth: int = 0

    def sum(self) -> float:
        value = self.product()
        while self.next_is("+", "-"):
            value = value + self.product() if self.take() == "+" else value - self.product()
        return value

    def product(self) -> float:
        value = self.factor()
        while self.next_is("*", "/"):
            value = value * self.factor() if self.take() == "*" else value / self.factor()
        return value

    def factor(self) -> float:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise ExpressionError(f"nested deeper than {MAX_DEPTH}")
        if self.next_is("-", "+"):
            value = -self.factor() if self.take() == "-" else self.factor()
        else:
            value = self.power()
        self.depth -= 1
        return value

    def power(self) -> float:
        base = self.atom()
        if self.next_is("^", "**"):
            self.take()
            return math.pow(base, self.factor())
        return base

    def atom(self) -> float:
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

    def call(self, name: str) -> float:
        if name not in _FUNCTIONS:
            raise ExpressionError(f"the function {shown(name)} is unknown: {nearest(name, _FUNCTIONS)}")
        count, function = _FUNCTIONS[name]
        self.take()
        arguments = [self.sum()]
        while self.next_is(","):
            self.take()
            arguments.append(self.sum())
        self.expect(")")
        if len(arguments) != count:
            raise ExpressionError(f"{name} takes {count} argument{'s' * (count > 1)}, not {len(arguments)}")
        return function(*arguments)

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
