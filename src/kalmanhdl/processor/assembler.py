"""The assembler: sources as in appendix B of bhatia2012 become words.

A source has a section ``.text`` of instructions and a section ``.data`` of names for matrices. ``--`` begins
a comment. ``NAME:`` in the text is a label; in the data it takes the next matrix of the store, and a word
behind it is a second name of the same matrix. Operands are names or numbers, decimal or ``0x``.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NoReturn

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.core import Core, checked, functions_of, missing
from kalmanhdl.processor.instructions import (
    FUNCTIONS,
    OPERATIONS,
    WORD_BITS,
    Kind,
    Operation,
    build,
    encode,
)
from kalmanhdl.processor.program import Program
from kalmanhdl.validation import nearest, shown

ALIASES = {"JUMP_DRDY_I": "JUMP_DRDY", "JUMP_ACK_O": "JUMP_ACK"}
"""Second mnemonics: the paper's prose writes these two jumps with the signal's direction."""

RAW_WORD = ".word"
"""The directive that places a word as it is."""

_TOKEN = re.compile(r"[^\s,]+")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_NUMBER = re.compile(r"-?(0[xX][0-9A-Fa-f]{1,16}|[0-9]{1,16})\Z")
_COMMENT = "--"


class _Section(Enum):
    TEXT = ".text"
    DATA = ".data"


@dataclass(frozen=True, slots=True)
class _Token:
    """A word of the source with its place, both counted from 1."""

    text: str
    line: int
    column: int


@dataclass(frozen=True, slots=True)
class _Statement:
    """A word of the program before its names are known: the mnemonic or directive, and its operands."""

    head: _Token
    operands: tuple[_Token, ...]


@dataclass(slots=True)
class _Assembly:
    """What the first pass gathers."""

    name: str
    core: Core
    statements: list[_Statement] = field(default_factory=list)
    labels: dict[str, int] = field(default_factory=dict)
    matrices: dict[str, int] = field(default_factory=dict)
    allocated: int = 0

    def refuse(self, token: _Token, problem: str) -> NoReturn:
        raise ProgramError(f"{self.name}, line {token.line}, column {token.column}: {problem}")


def assemble(source: str, core: Core, name: str = "source") -> Program:
    """The program of a source, for a core; ``name`` is what messages call the source.

    Raises ProgramError with source, line and column of the first thing that is wrong.
    """
    assembly = _Assembly(name, core)
    _gather(source, assembly)
    if not assembly.statements:
        raise ProgramError(f"{name}: there is no instruction: write at least one below .text")
    words = tuple(_word(statement, assembly) for statement in assembly.statements)
    _check_loops(words, assembly)
    return Program(
        words=words,
        lines=tuple(statement.head.line for statement in assembly.statements),
        source=source,
        labels=assembly.labels,
        matrices=assembly.matrices,
    )


def _check_loops(words: tuple[int, ...], assembly: _Assembly) -> None:
    """What ``checked`` says of loops, with the line. Words given as they are may be none of the core's."""
    heads = [statement.head for statement in assembly.statements]
    if any(head.text == RAW_WORD for head in heads):
        return
    try:
        checked(words, assembly.core)
    except ProgramError as error:
        place, _, problem = str(error).partition(": ")
        assembly.refuse(heads[int(place.removeprefix("address "))], problem)


def _tokens(source: str) -> Iterator[list[_Token]]:
    for number, line in enumerate(source.splitlines(), start=1):
        code = line.partition(_COMMENT)[0]
        yield [_Token(match[0], number, match.start() + 1) for match in _TOKEN.finditer(code)]


def _gather(source: str, assembly: _Assembly) -> None:
    """First pass: labels, names of matrices, and statements in their order."""
    section = _Section.TEXT
    sections = {each.value: each for each in _Section}
    for tokens in _tokens(source):
        if not tokens:
            continue
        head = tokens[0]
        if head.text in sections:
            section = sections[head.text]
            if len(tokens) > 1:
                assembly.refuse(tokens[1], f"{shown(tokens[1].text)}: nothing stands behind {head.text}")
        elif section is _Section.TEXT:
            _gather_text(tokens, assembly)
        else:
            _gather_data(tokens, assembly)


def _gather_text(tokens: Sequence[_Token], assembly: _Assembly) -> None:
    while tokens and tokens[0].text.endswith(":"):
        label = _defined(tokens[0], assembly)
        assembly.labels[label] = len(assembly.statements)
        tokens = tokens[1:]
    if not tokens:
        return
    if len(assembly.statements) == assembly.core.program_words:
        assembly.refuse(
            tokens[0],
            f"the control store has {assembly.core.program_words} words, and this is one more: shorten it",
        )
    assembly.statements.append(_Statement(tokens[0], tuple(tokens[1:])))


def _gather_data(tokens: Sequence[_Token], assembly: _Assembly) -> None:
    head = tokens[0]
    if not head.text.endswith(":"):
        assembly.refuse(head, f"{shown(head.text)}: a line of .data begins with a name and a colon, NAME:")
    if assembly.allocated == assembly.core.matrices:
        assembly.refuse(
            head,
            f"the data store has {assembly.core.matrices} matrices, and this is one more: use them again",
        )
    assembly.matrices[_defined(head, assembly)] = assembly.allocated
    if len(tokens) > 1:
        assembly.matrices[_defined(tokens[1], assembly)] = assembly.allocated
    if len(tokens) > 2:
        assembly.refuse(tokens[2], f"{shown(tokens[2].text)}: a matrix has one name and at most one more")
    assembly.allocated += 1


def _defined(token: _Token, assembly: _Assembly) -> str:
    """A name that is being defined: well formed, and for the first time."""
    name = token.text.removesuffix(":")
    if not _NAME.match(name):
        assembly.refuse(
            token, f"{shown(name)} is no name: use letters, digits and _, and begin with no digit"
        )
    if name in OPERATIONS or name in ALIASES:
        assembly.refuse(token, f"{name} is an instruction: call it something else")
    if name in assembly.labels or name in assembly.matrices:
        assembly.refuse(token, f"{name} is defined already: give every place its own name")
    return name


def _word(statement: _Statement, assembly: _Assembly) -> int:
    head, operands = statement.head, statement.operands
    if head.text == RAW_WORD:
        return _raw_word(statement, assembly)
    operation = OPERATIONS.get(ALIASES.get(head.text, head.text))
    if operation is None:
        assembly.refuse(head, f"unknown instruction {shown(head.text)}: {nearest(head.text, OPERATIONS)}")
    if not assembly.core.has(operation.opcode):
        assembly.refuse(head, f"{operation.opcode.name}: {missing(operation.opcode, assembly.core)}")
    wanted = operation.operands
    if len(operands) != len(wanted):
        place = operands[len(wanted)] if len(operands) > len(wanted) else head
        assembly.refuse(place, _count_problem(operation, len(operands)))
    values = (_value(token, each.kind, assembly) for token, each in zip(operands, wanted, strict=True))
    return encode(build(operation.opcode, *values))


def _count_problem(operation: Operation, given: int) -> str:
    names = ", ".join(operand.name for operand in operation.operands) or "none"
    return f"{operation.opcode.name} has {len(operation.operands)} operands ({names}), and {given} stand here"


def _raw_word(statement: _Statement, assembly: _Assembly) -> int:
    if len(statement.operands) != 1:
        assembly.refuse(statement.head, f"{RAW_WORD} has one operand, a word such as 0x80000000")
    token = statement.operands[0]
    if not _NUMBER.match(token.text) or _number(token) >> WORD_BITS:
        assembly.refuse(token, f"{shown(token.text)} is no word: write a number of {WORD_BITS} bits")
    return _number(token)


def _number(token: _Token) -> int:
    return int(token.text, 16 if "x" in token.text.lower() else 10)


def _value(token: _Token, kind: Kind, assembly: _Assembly) -> int:
    if _NUMBER.match(token.text):
        value, allowed = _number(token), assembly.core.allowed(kind)
        if value not in allowed:
            if kind is Kind.FUNCTION:
                assembly.refuse(
                    token, f"the core has no function {value}: it has {functions_of(assembly.core)}"
                )
            assembly.refuse(token, f"{kind.value} {value} is outside {allowed[0]} to {allowed[-1]}")
        return value
    return _named(token, kind, assembly)


def _function(token: _Token, assembly: _Assembly) -> int:
    words = {each.value: FUNCTIONS.index(each) for each in assembly.core.functions}
    if token.text not in words:
        assembly.refuse(token, f"the core has no function {shown(token.text)}: {nearest(token.text, words)}")
    return words[token.text]


def _named(token: _Token, kind: Kind, assembly: _Assembly) -> int:
    match kind:
        case Kind.MATRIX:
            names, others, section = assembly.matrices, assembly.labels, _Section.DATA
        case Kind.TARGET:
            names, others, section = assembly.labels, assembly.matrices, _Section.TEXT
        case Kind.ELEMENT | Kind.COUNT | Kind.EXPONENT:
            allowed = assembly.core.allowed(kind)
            rule = f"write {allowed[0]} to {allowed[-1]}"
            assembly.refuse(token, f"{shown(token.text)} is no {kind.value}: {rule}")
        case Kind.FUNCTION:
            return _function(token, assembly)
    if token.text in others:
        assembly.refuse(token, f"{token.text} is no {kind.value}: what is one is defined in {section.value}")
    if token.text not in names:
        assembly.refuse(
            token,
            f"undefined {kind.value} {shown(token.text)}: define it in {section.value}; "
            f"{nearest(token.text, names)}",
        )
    if names[token.text] not in assembly.core.allowed(kind):
        assembly.refuse(token, f"{token.text} stands behind the last word of the control store")
    return names[token.text]
