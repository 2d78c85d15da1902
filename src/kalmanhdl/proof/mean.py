"""Bounds of the states that see the measurements, over every input within its limits."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.graph.builder import reachable
from kalmanhdl.graph.operations import And, Flag, Input, is_flag, operands
from kalmanhdl.numerics.typed import Interval, TypedGraph, Violation
from kalmanhdl.proof.affine import Affine, Leaves, affine_forms, flag_values
from kalmanhdl.proof.intervals import leaves
from kalmanhdl.proof.paths import Box, Front, Steps, worst
from kalmanhdl.proof.reachable import Edges, Reachable
from kalmanhdl.proof.subgraph import Part, states_of

Array = NDArray[np.float64]

# A box is widened by so little beyond where it settles, in at most so many rounds.
_SLACK, _ROUNDS = 1e-6, 500


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """Bounds in real numbers of the hardware's units: of states by name, of quantised values by operation."""

    states: dict[str, tuple[float, float]]
    values: dict[int, tuple[float, float]]


def boundary(typed: TypedGraph, part: Part, known: frozenset[int]) -> list[int]:
    """The decided values, but for commands themselves, that others of a part are computed from."""
    operations, roots = typed.graph.operations, dict(typed.graph.states)
    targets = [*(roots[name] for name in part.others), *(v.quantise for v in _own(typed, part, known))]
    seen = reachable(operations, targets) - known
    read = {a for index in seen for a in operands(operations[index])} | set(targets)
    return sorted(a for a in read & known if not isinstance(operations[a], Flag))


def _own(typed: TypedGraph, part: Part, known: frozenset[int]) -> list[Violation]:
    """The violations of values that a part alone computes, and that are not decided."""
    names = {*part.decided, *part.others}
    undecided = [v for v in typed.violations if v.quantise not in known]
    return [v for v in undecided if states_of(typed, v.quantise) <= names]


def bounded(
    typed: TypedGraph,
    part: Part,
    known: frozenset[int],
    reach: Reachable,
    shown: tuple[int, ...],
    limits: Mapping[str, Interval],
    start: Mapping[str, Interval],
) -> Mean | str:
    """Bounds of the other states of a part, whose decided ones are ``reach``, or why there are none.

    ``shown`` are the operations whose values the edges show; ``limits`` are the raw numbers that inputs
    take, ``start`` those of the states of a track that has just started.
    """
    if reach.edges is None:
        return f"{reach.count} covariances are too many to follow"
    return _Analysis(typed, part, known, reach, reach.edges, shown, limits, start).run()


class _Analysis:
    """The analysis of one part; everything is an array over its running edges."""

    def __init__(
        self,
        typed: TypedGraph,
        part: Part,
        known: frozenset[int],
        reach: Reachable,
        edges: Edges,
        shown: tuple[int, ...],
        limits: Mapping[str, Interval],
        start: Mapping[str, Interval],
    ) -> None:
        self.typed, self.part = typed, part
        self.running = np.flatnonzero(edges.source >= 0)
        self.own = [v for v in _own(typed, part, known) if v.running]
        self.roots = dict(typed.graph.states)
        targets = [*(self.roots[name] for name in part.others), *(v.quantise for v in self.own)]
        self.cone = sorted(reachable(typed.graph.operations, targets))
        self.places = leaves(typed)
        operations = typed.graph.operations
        inputs = [op.name for k in self.cone if isinstance(op := operations[k], Input)]
        self.leaves = self._leaves(edges, reach, shown, (*part.others, *inputs))
        self.forms = affine_forms(typed, self.cone, self.leaves)
        low, high = self._inputs(inputs, limits)
        self.middle, self.radius = (low + high) / 2, (high - low) / 2
        self.whole = self._box({name: self._format(name) for name in part.others})
        self.start = self._box({name: self._real(name, start[name]) for name in part.others})
        states = np.maximum(np.abs(self.whole.low), np.abs(self.whole.high))
        states = np.broadcast_to(states, (len(self.running), len(states)))
        self.greatest = np.hstack([states, np.maximum(np.abs(low), np.abs(high))])
        self.edges, self.count = edges, reach.count

    def _leaves(
        self, edges: Edges, reach: Reachable, shown: tuple[int, ...], variables: tuple[str, ...]
    ) -> Leaves:
        patterns = np.array(reach.patterns, bool).reshape(len(reach.patterns), -1)[
            edges.pattern[self.running]
        ]
        flags = {name: patterns[:, k] for k, name in enumerate(self.part.flags)}
        numbers, decided = {}, {}
        for column, index in enumerate(shown):
            values = edges.shown[self.running, column]
            form = self.typed.formats[index]
            if is_flag(self.typed.graph.operations[index]):
                decided[index] = values.astype(bool)
            elif form is not None:
                numbers[index] = values * float(form.resolution)
        return Leaves(
            edges=len(self.running),
            flags={**flags, "initialise": np.zeros(len(self.running), bool)},
            numbers=numbers,
            decided=decided,
            variables=variables,
        )

    def _format(self, name: str) -> tuple[float, float]:
        form = self.typed.formats[self.places[name]]
        assert isinstance(form, Fixed)
        return float(form.real(form.lowest)), float(form.real(form.highest))

    def _real(self, name: str, interval: Interval) -> tuple[float, float]:
        form = self.typed.formats[self.places[name]]
        assert isinstance(form, Fixed)
        return float(form.real(interval.low)), float(form.real(interval.high))

    def _box(self, limits: Mapping[str, tuple[float, float]]) -> Box:
        low, high = np.array([limits[name] for name in self.part.others], float).reshape(-1, 2).T
        return Box(low, high)

    def _inputs(self, names: list[str], limits: Mapping[str, Interval]) -> tuple[Array, Array]:
        """The limits of inputs on each edge: a measurement that is missed may be any number."""
        ends = np.empty((2, len(self.running), len(names)))
        for k, name in enumerate(names):
            there = self.leaves.flags.get(f"valid{name.removeprefix('z')}", np.ones(len(self.running), bool))
            declared = self._real(name, limits[name]) if name in limits else self._format(name)
            for end in range(2):
                ends[end, :, k] = np.where(there, declared[end], self._format(name)[end])
        return ends[0], ends[1]

    def run(self) -> Mean | str:
        names, roots = self.part.others, self.roots
        lacking = [name for name in names if roots[name] not in self.forms]
        if lacking:
            return f"{lacking[0]} is no affine function of states and inputs"
        steps = self._steps([self.forms[roots[name]] for name in names])
        fronts = [self._front(self.forms[roots[name]], sign, None) for name in names for sign in (1, -1)]
        box = self.whole
        for _ in range(2):
            fronts = [worst(front, steps, box, self.start) for front in fronts]
            settled = self._settled(fronts, steps)
            if settled is None:
                return "no box within the formats holds the states for every input"
            box = settled
        values = {v.quantise: found for v in self.own if (found := self._reach(v, steps, box)) is not None}
        inside = reachable(self.typed.graph.operations, [roots[name] for name in names])
        for v in self.own:
            if v.quantise in inside and not self._fits(v.quantise, values.get(v.quantise)):
                return f"{self.typed.graph.origins[v.quantise]} may leave its format, and the states with it"
        values = {index: found for index, found in values.items() if self._stands(index, values)}
        return Mean(
            states={
                name: (float(low), float(high))
                for name, low, high in zip(names, box.low, box.high, strict=True)
            },
            values=values,
        )

    def _steps(self, forms: list[Affine]) -> Steps:
        k = len(forms)
        target = self.edges.target[self.running]
        fresh = np.zeros(self.count, bool)
        fresh[self.edges.target[self.edges.source < 0]] = True
        rows = [self._row(form) for form in forms]
        return Steps(
            A=np.stack([row[0] for row in rows], axis=1).reshape(len(self.running), k, k),
            offset=np.stack([row[1] for row in rows], axis=1),
            driven=np.stack([row[2] for row in rows], axis=1),
            reach=np.stack([row[3] for row in rows], axis=1),
            source=self.edges.source[self.running],
            first=np.concatenate([[0], np.cumsum(np.bincount(target, minlength=self.count))]),
            order=np.argsort(target, kind="stable"),
            fresh=fresh,
        )

    def _row(self, form: Affine) -> tuple[Array, Array, Array, Array]:
        """A form as slopes by states, middle, what inputs do, and what errors do."""
        k = len(self.part.others)
        driven = form.slopes[:, k:]
        middle = form.constant + (driven * self.middle).sum(axis=1) + (form.low + form.high) / 2
        error = (form.high - form.low) / 2 + form.lost(self.greatest)
        return form.slopes[:, :k], middle, driven * self.radius, error

    def _front(self, form: Affine, sign: int, chosen: NDArray[np.bool_] | None) -> Front:
        slopes, middle, driven, error = self._row(form)
        front = Front(
            sign * middle + np.abs(driven).sum(axis=1) + error,
            sign * slopes,
            self.edges.source[self.running],
        )
        return front if chosen is None else front.taken(chosen)

    def _settled(self, fronts: list[Front], steps: Steps) -> Box | None:
        """A box within the formats that the fronts, closed with it, do not leave."""
        box = self.start
        for _ in range(_ROUNDS):
            ends = np.array([front.bound(steps, box, self.start).max() for front in fronts]).reshape(-1, 2)
            high, low = np.maximum(ends[:, 0], self.start.high), np.minimum(-ends[:, 1], self.start.low)
            if (low < self.whole.low).any() or (high > self.whole.high).any():
                return None
            if (low >= box.low).all() and (high <= box.high).all():
                return box
            room = _SLACK * (high - low)
            box = Box(np.minimum(low - room, box.low), np.maximum(high + room, box.high))
            box = Box(np.maximum(box.low, self.whole.low), np.minimum(box.high, self.whole.high))
        return None

    def _reach(self, violation: Violation, steps: Steps, box: Box) -> tuple[float, float] | None:
        """The bounds of a quantised value where it matters, None where it is not affine."""
        form = self.forms.get(violation.quantise)
        matters = self._matters(violation.outside)
        if form is None or not matters.any():
            return None if form is None else (0.0, 0.0)
        fronts = [worst(self._front(form, sign, matters), steps, box, self.start) for sign in (1, -1)]
        high, low = (float(front.bound(steps, box, self.start).max()) for front in fronts)
        return -low, high

    def _matters(self, outside: int) -> NDArray[np.bool_]:
        """The edges on which a flag is not known never to hold."""
        operation = self.typed.graph.operations[outside]
        if isinstance(operation, And):
            return self._matters(operation.a) & self._matters(operation.b)
        value = flag_values(self.typed, outside, self.leaves)
        return np.ones(len(self.running), bool) if value is None else value

    def _stands(self, index: int, values: Mapping[int, tuple[float, float]]) -> bool:
        """Whether all that a value is computed from stays in its format, as affine forms take for granted."""
        seen = reachable(self.typed.graph.operations, operands(self.typed.graph.operations[index]))
        return all(self._fits(v.quantise, values.get(v.quantise)) for v in self.own if v.quantise in seen)

    def _fits(self, index: int, found: tuple[float, float] | None) -> bool:
        form = self.typed.formats[index]
        assert form is not None
        if found is None:
            return False
        return float(form.real(form.lowest)) <= found[0] and found[1] <= float(form.real(form.highest))
