"""A filter whose numbers are coefficients: kept by the hardware, and changed without building it anew.

Which numbers those are is found by tracing. The algorithm runs on the model and on others of the same pattern
of zeros, whose numbers are drawn at random. A number that it computes with is a coefficient where it differs
between the models, and two of them are one where they are equal in all (after Schwartz 1980 and Zippel 1979:
numbers that depend on a model in different ways hardly ever agree on random ones). So what an algorithm
derives from the model before it runs, such as the inverse about which Taylor's gain expands, is a coefficient
too, which the host computes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm.filter import Filter
from kalmanhdl.algorithm.trace import Pattern, on_builder, started
from kalmanhdl.errors import ModelError
from kalmanhdl.graph.builder import Builder
from kalmanhdl.graph.operations import Coefficient, Graph
from kalmanhdl.graph.simplify import simplified
from kalmanhdl.model.model import Model
from kalmanhdl.model.state_space import Initial, LinearModel

Array = NDArray[np.float64]
Numbers = tuple[float, ...]

# How far numbers are moved to tell them apart, and on how many models.
_MOVED, _MODELS, _SEED = 1e-3, 2, 1980


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Traced:
    """The graph of a step with ``Coefficient`` leaves, and what must be known to trace another model alike.

    ``kinds[k]`` is the number of the coefficient that the k-th number of the algorithm is, None for one that
    is the same for every model.
    """

    graph: Graph
    pattern: Pattern
    kinds: tuple[int | None, ...]


class UnlikeError(ModelError):
    """A model on which the algorithm takes other steps than on the one that the hardware was built for."""


class _Recorder(Builder):
    """Notes every number that is not zero; each is a leaf of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.numbers: list[float] = []

    def number(self, value: float) -> int:
        if value == 0.0:
            return self.constant(0.0)
        self.numbers.append(value)
        return self.intern(Coefficient(f"c[{len(self.numbers) - 1}]", Fraction(value)))


class _Sorted(Builder):
    """Takes numbers for what was found of them: coefficients, or numbers of every model."""

    def __init__(self, kinds: Sequence[int | None]) -> None:
        super().__init__()
        self._kinds = kinds
        self.count = 0

    def number(self, value: float) -> int:
        if value == 0.0:
            return self.constant(0.0)
        if self.count == len(self._kinds):
            raise UnlikeError
        kind, self.count = self._kinds[self.count], self.count + 1
        if kind is None:
            return self.constant(value)
        index = self.intern(Coefficient(f"c[{kind}]", Fraction(value)))
        self.name(index, f"c[{kind}]")
        return index


def trace_loadable(model: LinearModel, filter_of: Callable[[LinearModel], Filter]) -> Traced:
    """The graph of one step in which every number of the model's pattern is a coefficient.

    ``filter_of`` makes the filter of a model. Raises UnlikeError where the algorithm has numbers of the model
    in other places than its arithmetic, or takes its steps by more than the pattern.
    """
    pattern = _settled(model, filter_of(model))
    models = [model, *(moved(model, _SEED + k) for k in range(_MODELS))]
    recorded = [_recorded(each, filter_of(each), pattern) for each in models]
    if len({len(numbers) for numbers in recorded}) > 1:
        raise UnlikeError
    known: dict[Numbers, int] = {}
    kinds = tuple(
        None if len(set(seen)) == 1 else known.setdefault(seen, len(known))
        for seen in zip(*recorded, strict=True)
    )
    found = Traced(graph=_traced(model, filter_of(model), pattern, kinds), pattern=pattern, kinds=kinds)
    for each in models[1:]:
        coefficients(found, each, filter_of)
    return found


def coefficients(
    found: Traced, model: LinearModel, filter_of: Callable[[LinearModel], Filter]
) -> dict[str, Fraction]:
    """The coefficients of another model, by name. Raises UnlikeError where it needs other hardware."""
    graph = _traced(model, filter_of(model), found.pattern, found.kinds)
    if _blank(graph) != _blank(found.graph):
        raise UnlikeError
    return values(graph)


def values(graph: Graph) -> dict[str, Fraction]:
    """The values of a graph's coefficients, by name."""
    return {op.name: op.value for op in graph.operations if isinstance(op, Coefficient)}


def _settled(model: Model, filter_: Filter) -> Pattern:
    """The elements of the memory that any step fills."""
    pattern = started(model, filter_, _Recorder())
    while True:
        _, filled = on_builder(_Recorder(), model, filter_, pattern)
        if all(np.array_equal(filled[name], pattern[name]) for name in pattern):
            return pattern
        pattern = filled


def _recorded(model: Model, filter_: Filter, pattern: Pattern) -> list[float]:
    builder = _Recorder()
    on_builder(builder, model, filter_, pattern)
    return builder.numbers


def _traced(model: Model, filter_: Filter, pattern: Pattern, kinds: Sequence[int | None]) -> Graph:
    builder = _Sorted(kinds)
    graph, _ = on_builder(builder, model, filter_, pattern)
    if builder.count != len(kinds):
        raise UnlikeError
    return simplified(graph)


def _blank(graph: Graph) -> Graph:
    blank = (replace(op, value=Fraction(0)) if isinstance(op, Coefficient) else op for op in graph.operations)
    return replace(graph, operations=tuple(blank))


def moved(model: LinearModel, seed: int) -> LinearModel:
    """A model of the same pattern whose numbers are others: covariances stay ones."""
    random = np.random.default_rng(seed)

    def other(array: Array) -> Array:
        return np.asarray(array * (1.0 + _MOVED * random.uniform(-1.0, 1.0, array.shape)))

    def covariance(matrix: Array) -> Array:
        factor = 1.0 + _MOVED * random.uniform(-1.0, 1.0, len(matrix))
        return np.asarray(matrix * np.outer(factor, factor))

    return replace(
        model,
        F=other(model.F),
        H=other(model.H),
        Q=covariance(model.Q),
        R=covariance(model.R),
        B=other(model.B),
        offset=other(model.offset),
        measurement_offset=other(model.measurement_offset),
        initial=_moved_start(model.initial, other, covariance),
        nis_weight=None if model.nis_weight is None else other(model.nis_weight),
    )


def _moved_start(
    start: Initial, other: Callable[[Array], Array], covariance: Callable[[Array], Array]
) -> Initial:
    control, noise = start.from_control, start.from_noise
    return replace(
        start,
        x=other(start.x),
        P=covariance(start.P),
        from_measurement=other(start.from_measurement),
        from_state=other(start.from_state),
        from_control=None if control is None else other(control),
        from_noise=None if noise is None else other(noise),
    )
