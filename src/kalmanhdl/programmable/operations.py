"""What a programmable datapath is told to do: operations on words, each with its rounding."""

from dataclasses import dataclass, field
from enum import Enum, IntEnum

from kalmanhdl.arithmetic.fixed import Overflow, Rounding


class AddFunction(IntEnum):
    """What an adder makes of its operands a, b and the flag c; the value is the code in the store."""

    ADD = 0
    SUBTRACT = 1
    SELECT = 2
    """a where c holds, else b."""
    NEGATIVE = 3
    """1 where a < 0, else 0."""


ROUNDING_CODES = {rounding: code for code, rounding in enumerate(Rounding)}
"""The codes of the roundings in the store."""


class Kind(Enum):
    """The kinds of unit."""

    MULTIPLY = "multiply"
    ADD = "add"
    RECIPROCAL = "reciprocal"
    INPUT = "input"


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """What becomes of an exact result: ``dropped`` bits are rounded away, then it is brought into a format.

    A negative count appends zeros. ``watch_*``: a rounded value outside of the format sets ``saturated``, in
    steps that initialise, and in others.
    """

    dropped: int
    width: int
    signed: bool = True
    rounding: Rounding = Rounding.FLOOR
    overflow: Overflow = Overflow.SATURATE
    watch_starting: bool = False
    watch_running: bool = False


@dataclass(frozen=True, slots=True)
class Fixture:
    """A word that is the same in every step: a raw integer."""

    raw: int


@dataclass(frozen=True, slots=True)
class Kept:
    """A state, as the step before left it, with ``lift`` more fraction bits than its own."""

    state: str
    lift: int


@dataclass(frozen=True, slots=True)
class Result:
    """What an operation of this step gives, by its number."""

    operation: int


Word = Fixture | Kept | Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Operation:
    """One operation of a unit. ``operands`` stand in the order of the unit's ports; for a flag c may lack.

    ``function`` is that of an adder, ``stage`` what both multipliers and adders have, ``exponent`` that of an
    exact reciprocal, 2**exponent / operand. ``input`` is what an input is called.
    """

    kind: Kind
    origin: str
    operands: tuple[Word, ...] = ()
    stage: Stage | None = None
    function: AddFunction = AddFunction.ADD
    exponent: int | None = None
    input: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A step of a filter in operations of units, in topological order.

    ``states`` gives for each state, as it is read, the operation whose result it takes, ``outputs`` for each
    output; no operation is there twice in either.
    """

    operations: tuple[Operation, ...]
    states: dict[Kept, int] = field(default_factory=dict)
    outputs: dict[str, int] = field(default_factory=dict)
