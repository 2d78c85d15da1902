"""A step in floating point: what a design asks for, and the graph whose every operation rounds once."""

from dataclasses import InitVar, dataclass, replace
from fractions import Fraction
from types import MappingProxyType

import numpy as np

from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.algorithm.trace import trace
from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.arithmetic.floating import EXPONENTS, MANTISSAS, MODES, Float
from kalmanhdl.errors import FormatError
from kalmanhdl.graph.balance import balanced
from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.operations import (
    Add,
    Binary,
    Constant,
    Divide,
    Graph,
    Multiply,
    Negative,
    NotFinite,
    Operation,
    Reciprocal,
    Subtract,
    Table,
    Unary,
    is_flag,
    operands,
)
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.float_functions import without_functions
from kalmanhdl.numerics.ranges import cone
from kalmanhdl.numerics.saturated import NAME, sticky
from kalmanhdl.numerics.scaling import Scaling
from kalmanhdl.validation import InvalidValueError, flag, integer, nearest, shown

FORMATS = MappingProxyType({"half": (5, 10), "single": (8, 23), "double": (11, 52)})
"""The words for exponent and mantissa."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FloatSpecification:
    """Floating-point arithmetic as the user asks for it: one format for every number, rounded once by each
    operation; a number has a sign, ``exponent`` bits and ``mantissa`` bits, (8, 23) being single precision.
    In place of both, ``format`` takes the word "half", "single" or "double".

    Without ``subnormals``, numbers below the least normal one count as zeros. ``fused``: a product that
    only one sum uses is not rounded on its own.

    Raises:
        DesignError: a size or a rounding that is not offered.
    """

    # Without a value only until it is checked whether the word for both is there.
    exponent: int = None  # type: ignore[assignment]
    mantissa: int = None  # type: ignore[assignment]
    rounding: Rounding = Rounding.HALF_EVEN
    subnormals: bool = True
    fused: bool = False
    format: InitVar[str | None] = None

    def __post_init__(self, format: str | None) -> None:
        exponent, mantissa = _sizes(self.exponent, self.mantissa, format)
        found = {"exponent": exponent, "mantissa": mantissa, "rounding": _rounding(self.rounding)}
        found |= {key: flag("numerics", key, getattr(self, key)) for key in ("subnormals", "fused")}
        for key, value in found.items():
            object.__setattr__(self, key, value)

    @property
    def form(self) -> Float:
        """The format."""
        return Float(self.exponent, self.mantissa, self.rounding, self.subnormals)


def _sizes(exponent: object, mantissa: object, word: object) -> tuple[int, int]:
    """The bits of exponent and mantissa, None where they are not given, or a word for both."""
    both = {"exponent": exponent, "mantissa": mantissa}
    given = {key for key, value in both.items() if value is not None}
    if word is not None:
        if not isinstance(word, str) or word not in FORMATS:
            hint = nearest(str(word), FORMATS)
            raise InvalidValueError("numerics", "format", f" = {shown(word)} is unknown: {hint}")
        if given:
            problem = f" = {shown(word)} has its exponent and mantissa: leave them out, or the word"
            raise InvalidValueError("numerics", "format", problem)
        return FORMATS[word]
    for key in both:
        if key not in given:
            words = " or ".join(f'"{each}"' for each in FORMATS)
            raise InvalidValueError("numerics", key, f" is missing: write it, or format = {words}")
    return (
        integer("numerics", "exponent", exponent, EXPONENTS[0], EXPONENTS[-1]),
        integer("numerics", "mantissa", mantissa, MANTISSAS[0], MANTISSAS[-1]),
    )


def _rounding(word: object) -> Rounding:
    for mode in MODES:
        if word is mode or (isinstance(word, str) and word == mode.value):
            return mode
    given = word.value if isinstance(word, Rounding) else word
    words = ", ".join(mode.value for mode in MODES)
    raise InvalidValueError("numerics", "rounding", f" = {shown(given)}: one of {words}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Unbounded:
    """A value, by index, that must be neither infinite nor NaN in a step that initialises, in others, or
    in both: a state or an output, or one that is divided by or judged, after which nobody would see it.
    """

    value: int
    starting: bool
    running: bool


@dataclass(frozen=True, slots=True)
class FusedSum:
    """A product and a number that are added, or taken from each other, with one rounding."""

    product: int
    addend: int
    minus_product: bool
    minus_addend: bool


@dataclass(frozen=True)
class FloatGraph:
    """A graph whose numbers are all of one floating-point format.

    Every operation is its exact result rounded once (see ``arithmetic.floating``); ``Shift`` multiplies by
    a power of two, a ``Reciprocal`` is 1 / a. The only functions are the square root and ``wrap``; others
    have become operations (``numerics.float_functions``). Constants are numbers of the format.
    Multiplications listed in ``fused`` are not rounded: their one user is a fused multiply-add
    (``fused_sum``).

    ``violations`` are the values that must stay finite. ``scales`` gives the real value of one unit of
    each input, state and output. Operators of the kinds in ``clocks`` take so many clocks at least, from
    taking operands until another can take the result, which changes no result.
    """

    graph: Graph
    form: Float
    fused: frozenset[int]
    violations: tuple[Unbounded, ...]
    scales: dict[str, float]
    clocks: tuple[tuple[str, int], ...] = ()

    def fused_sum(self, index: int) -> "FusedSum | None":
        """What a sum that takes a fused product is made of; None for any other operation."""
        operation = self.graph.operations[index]
        if not isinstance(operation, Add | Subtract):
            return None
        less = isinstance(operation, Subtract)
        if operation.a in self.fused:
            return FusedSum(operation.a, operation.b, minus_product=False, minus_addend=less)
        if operation.b in self.fused:
            return FusedSum(operation.b, operation.a, minus_product=less, minus_addend=False)
        return None

    @property
    def formats(self) -> tuple[Float | None, ...]:
        """The format of each operation, None for flags."""
        return tuple(None if is_flag(operation) else self.form for operation in self.graph.operations)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloatNumbers:
    """A step in floating point: the graph of reals in the model's own units, and the same in a format."""

    scaling: Scaling
    graph: Graph
    typed: FloatGraph


def float_numbers(model: Model, algorithm: Algorithm, specification: FloatSpecification) -> FloatNumbers:
    """The floating-point numbers of one step of an algorithm on a model.

    Raises:
        FormatError: a constant of the model is too large or too small for the format.
    """
    scaling = Scaling(
        state=np.ones(model.n),
        measurement=np.ones(model.m),
        control=np.ones(model.p),
        covariance=np.ones(model.n),
    )
    filter_ = algorithm(model)
    graph = balanced(trace(model, filter_))
    typed = floated(graph, specification, scaling.units(filter_.kept))
    return FloatNumbers(scaling=scaling, graph=graph, typed=typed)


def floated(graph: Graph, specification: FloatSpecification, scales: dict[str, float]) -> FloatGraph:
    """A graph of reals in floating point. Raises FormatError as ``float_numbers``."""
    form = specification.form
    rounded = tuple(
        _rounded(form, operation, _place(graph, index)) for index, operation in enumerate(graph.operations)
    )
    graph = Graph(rounded, graph.origins, graph.states, graph.outputs)
    found = _violations(graph)
    # What a function makes of a finite number is finite inside it.
    graph, moved = without_functions(graph, form)
    violations = tuple(sorted((replace(v, value=moved[v.value]) for v in found), key=lambda v: v.value))
    return FloatGraph(
        graph=_watched(graph, violations),
        form=form,
        fused=_fused(graph) if specification.fused else frozenset(),
        violations=violations,
        scales=scales,
    )


def _watched(graph: Graph, violations: tuple[Unbounded, ...]) -> Graph:
    """The graph with its violations gathered into the flag ``saturated``."""
    builder = Builder.of(graph)
    flags = []
    for violation in violations:
        flag = builder.intern(NotFinite(violation.value))
        builder.name(flag, f"not finite: {graph.origins[violation.value]}")
        flags.append((flag, violation.starting, violation.running))
    saturated = (NAME, sticky(builder, flags))
    return Graph(
        tuple(builder.operations),
        tuple(builder.origins),
        (*graph.states, saturated),
        (*graph.outputs, saturated),
    )


def _rounded(form: Float, operation: Operation, place: str) -> Operation:
    match operation:
        case Constant(value):
            return Constant(_constant(form, value, place))
        case Table(rows=rows):
            return replace(operation, rows=tuple(_constant(form, row, place) for row in rows))
        case _:
            return operation


def _constant(form: Float, value: Fraction, place: str) -> Fraction:
    raw = form.nearest(value)
    if abs(value) >= Fraction(2) ** (form.bias + 1) or form.is_infinite(raw):
        limit = f"ends at {float(form.real(form.highest)):.6g}"
    elif value and not form.magnitude(raw):
        least = form.real(1 if form.subnormals else 1 << form.mantissa)
        limit = f"begins at {float(least):.6g}"
    else:
        return form.real(raw)
    raise FormatError(f"{place}: the constant {float(value):.6g} is no number of {form}, which {limit}: "
                      "use more bits for the exponent, or other units", table="numerics")  # fmt: skip


def _place(graph: Graph, index: int) -> str:
    """What an operation is for; of a constant, what it is used in."""
    origin = graph.origins[index]
    users = (graph.origins[user] for user in graph.users[index])
    return origin or next((each for each in users if each), "step")


def _fused(graph: Graph) -> frozenset[int]:
    """The products that become part of the one sum that uses them; of two in a sum the first."""
    found = set[int]()
    for index, operation in enumerate(graph.operations):
        if isinstance(operation, Add | Subtract) and operation.a != operation.b:
            products = [k for k in (operation.a, operation.b) if _is_product_of(graph, k, index)]
            found.update(products[:1])
    return frozenset(found)


def _is_product_of(graph: Graph, index: int, user: int) -> bool:
    """Whether a value is a product that one operation alone uses."""
    once = graph.users[index] == (user,) and index not in graph.roots
    return once and isinstance(graph.operations[index], Multiply)


def _violations(graph: Graph) -> tuple[Unbounded, ...]:
    starting, running = (cone(graph, initialise=flag) for flag in (True, False))
    roots = {k for k in graph.roots if not is_flag(graph.operations[k])}
    first, later = set(roots), set(roots)
    for index, operation in enumerate(graph.operations):
        hidden = set(_hidden(operation))
        first |= hidden if index in starting else set()
        later |= hidden if index in running else set()
    return tuple(
        Unbounded(value=k, starting=k in first, running=k in later)
        for k in sorted(first | later)
        if not isinstance(graph.operations[k], Constant)
    )


def _hidden(operation: Operation) -> tuple[int, ...]:
    """The operands whose infinity or NaN a result may not show."""
    match operation:
        case Divide(b=b):
            return (b,)
        case Reciprocal() | Negative() | Unary() | Binary() | Table():
            return operands(operation)
        case _:
            return ()
