"""The scalar dataflow graph: one class an operation, one frozen value a graph.

Operations refer to their operands by index into ``Graph.operations``, which stands in topological
order. Two kinds of value flow: numbers and flags (booleans). The same classes serve before formats
are known (numbers are reals) and after (numbers are raw integers; see ``numerics.typed``).
"""

from dataclasses import dataclass, fields
from enum import Enum
from fractions import Fraction
from functools import cached_property
from typing import get_args

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding


@dataclass(frozen=True, slots=True)
class Input:
    """A number that comes with every step: a measurement ``z[j]`` or a control ``u[k]``."""

    name: str


@dataclass(frozen=True, slots=True)
class Coefficient(Input):
    """A number ``c[k]`` of the model, or one derived from it, that the hardware keeps and can be given anew.

    ``value`` is that of the model of which the graph was made.
    """

    value: Fraction


@dataclass(frozen=True, slots=True)
class Flag:
    """A flag that comes with every step: ``initialise`` or ``valid[j]``."""

    name: str


@dataclass(frozen=True, slots=True)
class State:
    """A number kept from the step before, per track: ``x[i]`` or ``P[i,j]``."""

    name: str


@dataclass(frozen=True, slots=True)
class StateFlag:
    """A flag kept from the step before, per track: ``saturated``."""

    name: str


@dataclass(frozen=True, slots=True)
class Constant:
    """A number known when the hardware is built, exact."""

    value: Fraction


@dataclass(frozen=True, slots=True)
class Add:
    """a + b, exact."""

    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Subtract:
    """a - b, exact."""

    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Multiply:
    """a * b, exact. With a constant operand it is a constant multiplication."""

    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Shift:
    """a * 2**exponent, exact and free: only the binary point moves."""

    a: int
    exponent: int


@dataclass(frozen=True, slots=True)
class Divide:
    """a / b. Exact as a real; once typed, see ``arithmetic.division``."""

    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Reciprocal:
    """1 / a for a > 0. Exact as a real; once typed, see ``arithmetic.division``."""

    a: int


class Function(Enum):
    """Functions that are no arithmetic; angles are in turns, so that a full turn is one."""

    SINE = "sine"
    COSINE = "cosine"
    SQUARE_ROOT = "square_root"
    EXPONENTIAL = "exponential"
    WRAP = "wrap"
    """a less the nearest integer: an angle brought into half a turn to either side."""
    ARCTANGENT = "arctangent"
    """The angle of the point (b, a), from -1/2 to 1/2: a is its height, b its distance to the right."""
    HYPOTENUSE = "hypotenuse"


@dataclass(frozen=True, slots=True)
class Unary:
    """A function of one number. Exact as a real; typed graphs hold what it is computed by."""

    function: Function
    a: int


@dataclass(frozen=True, slots=True)
class Binary:
    """A function of two numbers. Exact as a real; typed graphs hold what it is computed by."""

    function: Function
    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Table:
    """The row whose number is a, an integer from 0; rows are exact."""

    a: int
    rows: tuple[Fraction, ...]


@dataclass(frozen=True, slots=True)
class Select:
    """a where the flag holds, else b."""

    flag: int
    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Quantise:
    """The one operation that loses bits: round, then bring into the format."""

    a: int
    form: Fixed
    rounding: Rounding
    overflow: Overflow


@dataclass(frozen=True, slots=True)
class Bits:
    """The bits of a that a format has, on purpose without the others: rounded down, modulo its range."""

    a: int
    form: Fixed


@dataclass(frozen=True, slots=True)
class Outside:
    """A flag: a, rounded to the format's fraction, does not fit the format."""

    a: int
    form: Fixed
    rounding: Rounding


@dataclass(frozen=True, slots=True)
class Product:
    """a * b, or less that, as one of several that are summed."""

    a: int
    b: int
    negative: bool = False


@dataclass(frozen=True, slots=True)
class SumOfProducts:
    """The exact sum of the products, quantised once. Of typed graphs that are made for multiply-add units."""

    terms: tuple[Product, ...]
    form: Fixed
    rounding: Rounding
    overflow: Overflow


@dataclass(frozen=True, slots=True)
class SumOutside:
    """A flag: the exact value of the sum of products a, rounded, does not fit its format."""

    a: int


@dataclass(frozen=True, slots=True)
class NotFinite:
    """A flag: a is infinite or no number. Of floating-point graphs; no real and no integer is."""

    a: int


@dataclass(frozen=True, slots=True)
class Negative:
    """A flag: a < 0."""

    a: int


@dataclass(frozen=True, slots=True)
class And:
    """Both flags hold."""

    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Or:
    """One of the flags holds."""

    a: int
    b: int


@dataclass(frozen=True, slots=True)
class Not:
    """The flag does not hold."""

    a: int


Number = (
    Input
    | Coefficient
    | State
    | Constant
    | Add
    | Subtract
    | Multiply
    | Shift
    | Divide
    | Reciprocal
    | Unary
    | Binary
    | Table
    | Select
    | Quantise
    | Bits
    | SumOfProducts
)
Boolean = Flag | StateFlag | Outside | SumOutside | NotFinite | Negative | And | Or | Not
Operation = Number | Boolean

_OPERANDS = {
    kind: tuple(f.name for f in fields(kind) if f.name in ("flag", "a", "b")) for kind in get_args(Operation)
}
_FLAGS = (Flag, StateFlag, Outside, SumOutside, NotFinite, Negative, And, Or, Not)


def operands(operation: Operation) -> tuple[int, ...]:
    """The indices that an operation reads, in the order of its fields."""
    if isinstance(operation, SumOfProducts):
        return tuple(k for term in operation.terms for k in (term.a, term.b))
    return tuple(getattr(operation, name) for name in _OPERANDS[type(operation)])


def lags(operation: Operation) -> tuple[int, ...]:
    """By how many turns of its unit each operand is taken later than the first."""
    if isinstance(operation, SumOfProducts):
        return tuple(turn for turn in range(len(operation.terms)) for _ in "ab")
    return (0,) * len(_OPERANDS[type(operation)])


def is_flag(operation: Operation) -> bool:
    """Whether the value is a flag rather than a number."""
    return isinstance(operation, _FLAGS)


@dataclass(frozen=True)
class Graph:
    """One step of a filter as scalar operations.

    ``origins[k]`` names the equation of ``operations[k]``, such as ``update: S[0,1]``. ``states`` gives
    the operation whose value a state takes for the next step, ``outputs`` what the step puts out; both
    are ordered. Every state that an operation reads is among ``states``.
    """

    operations: tuple[Operation, ...]
    origins: tuple[str, ...]
    states: tuple[tuple[str, int], ...]
    outputs: tuple[tuple[str, int], ...]

    @cached_property
    def roots(self) -> tuple[int, ...]:
        """The operations that a step is run for."""
        return tuple(index for _, index in (*self.states, *self.outputs))

    @cached_property
    def users(self) -> tuple[tuple[int, ...], ...]:
        """For each operation, those that read it."""
        users: list[list[int]] = [[] for _ in self.operations]
        for index, operation in enumerate(self.operations):
            for operand in dict.fromkeys(operands(operation)):
                users[operand].append(index)
        return tuple(map(tuple, users))
