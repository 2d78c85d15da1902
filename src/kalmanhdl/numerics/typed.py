"""A graph whose numbers are raw integers: a format and an interval for every operation."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from kalmanhdl.arithmetic.division import DivisionMethod
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.graph.operations import Coefficient, Graph


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """The raw integers, from ``low`` to ``high``, that a number can take."""

    low: int
    high: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """A quantisation and its flag, by index; it matters in a step that initialises, in others, or in both."""

    quantise: int
    outside: int
    starting: bool
    running: bool


@dataclass(frozen=True)
class TypedGraph:
    """A graph with its integers.

    ``formats[k]`` and ``intervals[k]`` belong to ``graph.operations[k]``, None for flags. The exact
    operations (add, subtract, multiply, shift, select) have formats wide enough for every value of
    their interval. For two operands of different fraction the value with fewer fraction bits is
    shifted left first: ``fraction = max(a, b)`` for add, subtract and select, the sum for multiply.
    Every ``Reciprocal`` and ``Divide`` is computed by ``division``, rounded by ``division_rounding``
    into its own format, and saturates. A ``Multiply`` without multiplier blocks is built as ``logic_product``
    says, which changes no result.

    ``violations`` lists the quantisations that can leave their format, each with its ``Outside`` flag and
    with the commands under which its value matters; only then is it a violation.

    ``scales`` gives the real value of one unit of each input, state and output: real = scale * raw *
    2**-fraction.
    """

    graph: Graph
    formats: tuple[Fixed | None, ...]
    intervals: tuple[Interval | None, ...]
    division: DivisionMethod
    division_rounding: Rounding
    violations: tuple[Violation, ...]
    scales: dict[str, float]
    logic_product: LogicProduct = LogicProduct.BOOTH

    @property
    def coefficients(self) -> dict[str, int]:
        """The raw integers of the coefficients, by name, for the model of which the graph was made."""
        both = zip(self.graph.operations, self.formats, strict=True)
        return {op.name: form.nearest(op.value) for op, form in both if isinstance(op, Coefficient) and form}

    def loaded(self, raws: Mapping[str, int]) -> "TypedGraph":
        """The same graph with other coefficients, given as raw integers by name."""
        both = zip(self.graph.operations, self.formats, strict=True)
        operations = tuple(
            replace(op, value=form.real(raws[op.name])) if isinstance(op, Coefficient) and form else op
            for op, form in both
        )
        return replace(self, graph=replace(self.graph, operations=operations))
