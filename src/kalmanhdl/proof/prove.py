"""Which values can never leave their formats, whatever inputs within their limits do.

A proof holds for tracks that start by their commands ``initialise`` in a row, whose inputs stay within the
limits that the model declares (where it declares none, within their formats), and that miss no measurement
more than ``coast`` times in a row.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from kalmanhdl.arithmetic.fixed import Fixed, rounded
from kalmanhdl.graph.operations import And, Flag, Or, Outside
from kalmanhdl.model.model import Model
from kalmanhdl.numerics.interval import aligned, of_format
from kalmanhdl.numerics.ranges import cone
from kalmanhdl.numerics.typed import Interval, TypedGraph
from kalmanhdl.proof.intervals import evaluate, leaves
from kalmanhdl.proof.mean import Mean, boundary, bounded
from kalmanhdl.proof.reachable import Contract, Reachable, explore
from kalmanhdl.proof.subgraph import Part, decided, parts, reduced, states_of

BY_INTERVALS = "intervals of a step"
BY_SEARCH = "all reachable covariances"
BY_PATHS = "the worst inputs"


@dataclass(frozen=True, slots=True, kw_only=True)
class PartProof:
    """What was found of states that belong together.

    ``covariances`` is how many states of the decided ones are reachable, None where they were not all found
    for the reason ``unsettled``; ``unbounded`` is why the others have no bounds.
    """

    states: tuple[str, ...]
    covariances: int | None
    unsettled: str
    unbounded: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """``proven[k]``: by what it is proven that violation k of the typed graph, by its quantised operation,
    never happens; ``reached[k]``: in how many steps from a reachable covariance it does. ``bounds[k]`` are
    raw limits of every number that holds them always."""

    contract: Contract
    proven: dict[int, str]
    reached: dict[int, int]
    bounds: dict[int, Interval]
    parts: tuple[PartProof, ...]


def prove(model: Model, typed: TypedGraph, coast: int) -> Proof:
    """What can be proven of a typed graph of a model. Raises ToolError where the engine does not compile."""
    initial = model.initial
    contract = Contract(
        points=initial.points,
        coast=coast,
        always=initial.takes_measurements,
        before_update=initial.before_update,
    )
    return _Prover(model, typed, contract).run()


class _Prover:
    def __init__(self, model: Model, typed: TypedGraph, contract: Contract) -> None:
        self.typed, self.contract = typed, contract
        self.places, self.known = leaves(typed), decided(typed)
        self.limits = input_limits(model, typed)
        self.by_input = {self.places[name]: interval for name, interval in self.limits.items()}
        self.extremes: dict[int, Interval] = {}
        self.proven: dict[int, str] = {}
        self.reached: dict[int, int] = {}

    def run(self) -> Proof:
        searched = [self._search(part) for part in parts(self.typed, self.known)]
        start, starting = self._started()
        known, found = dict(self.by_input) | self.extremes, []
        by_paths: set[int] = set()
        for part, reach, shown in searched:
            mean = self._mean(part, reach, shown, start)
            if isinstance(mean, Mean):
                known |= {
                    self.places[name]: self._raw(self.places[name], b) for name, b in mean.states.items()
                }
                known |= {index: self._raw(index, b) for index, b in mean.values.items()}
                by_paths |= set(mean.values)
            found.append(_summary(part, reach, mean))
        running = evaluate(self.typed, known, {"initialise": False})
        for v in self.typed.violations:
            if v.quantise in self.proven or v.quantise in self.reached:
                continue
            inside = v.quantise in by_paths and self._fits(v.quantise, known[v.quantise])
            if v.running and not inside and self._may_hold(v.outside, running):
                continue
            if v.starting and self._may_hold(v.outside, starting):
                continue
            self.proven[v.quantise] = BY_PATHS if inside else BY_INTERVALS
        return Proof(
            contract=self.contract,
            proven=self.proven,
            reached=self.reached,
            bounds=_hulls(self.typed, running, starting),
            parts=tuple(found),
        )

    def _search(self, part: Part) -> tuple[Part, Reachable | str, tuple[int, ...]]:
        """The reachable states of the decided ones of a part, and what its edges show."""
        if not part.decided:
            return part, "it follows the measurements", ()
        own = [
            v.quantise
            for v in self.typed.violations
            if v.quantise in self.known and states_of(self.typed, v.quantise) <= set(part.decided)
        ]
        wanted = [*boundary(self.typed, part, self.known), *own]
        smaller = reduced(self.typed, part.decided, wanted)
        seen = {op.name for op in smaller.typed.graph.operations if isinstance(op, Flag)}
        part = replace(part, flags=tuple(sorted({*part.flags, *seen} - {"initialise"})))
        reach = explore(smaller, part.flags, self.contract)
        shown = tuple(int(name) for name, _ in smaller.typed.graph.outputs)
        if isinstance(reach, Reachable):
            for index, interval in reach.extremes.items():
                self.extremes[smaller.places[index]] = interval
            for index, count in reach.violations.items():
                place = smaller.places[index]
                if count:
                    self.reached[place] = count
                else:
                    self.proven[place] = BY_SEARCH
        return part, reach, shown

    def _started(self) -> tuple[dict[str, Interval], list[Interval | None]]:
        """The states of a track that has just started, and all numbers of the last command of its start."""
        flags = {"initialise": True}
        if self.contract.always:
            names = [name for name in self.limits if name.startswith("z")]
            flags |= {f"valid{name[1:]}": True for name in names}
        states, found = dict[str, Interval](), list[Interval | None]()
        for point in range(self.contract.points):
            last = point == self.contract.points - 1
            known = self.by_input | {self.places[name]: interval for name, interval in states.items()}
            found = evaluate(self.typed, known | (self._extremes_of_values() if last else {}), flags)
            states = self._next(found)
        return states, found

    def _extremes_of_values(self) -> dict[int, Interval]:
        """The extremes of decided values, but for the states before a start, which may be any."""
        before = set(self.places.values())
        return {index: interval for index, interval in self.extremes.items() if index not in before}

    def _next(self, found: list[Interval | None]) -> dict[str, Interval]:
        states = {}
        for name, root in self.typed.graph.states:
            interval, form = found[root], self.typed.formats[root]
            if name in self.places and interval is not None and form is not None:
                leaf = self.typed.formats[self.places[name]]
                assert leaf is not None
                states[name] = aligned(interval, form, leaf.fraction)
        return states

    def _mean(
        self,
        part: Part,
        reach: Reachable | str,
        shown: tuple[int, ...],
        start: Mapping[str, Interval],
    ) -> Mean | str:
        if not part.others:
            return ""
        if isinstance(reach, str):
            return "its covariances were not all found"
        return bounded(self.typed, part, self.known, reach, shown, self.limits, start)

    def _raw(self, index: int, bound: tuple[float, float]) -> Interval:
        form = self.typed.formats[index]
        assert form is not None
        low, high = (math.ldexp(end, form.fraction) for end in bound)
        return Interval(low=math.floor(low), high=math.ceil(high))

    def _fits(self, index: int, interval: Interval) -> bool:
        form = self.typed.formats[index]
        assert form is not None
        return form.lowest <= interval.low and interval.high <= form.highest

    def _may_hold(self, index: int, found: list[Interval | None]) -> bool:
        operation = self.typed.graph.operations[index]
        match operation:
            case And(a, b):
                return self._may_hold(a, found) and self._may_hold(b, found)
            case Or(a, b):
                return self._may_hold(a, found) or self._may_hold(b, found)
            case Outside(a, form, rounding):
                exact, interval = self.typed.formats[a], found[a]
                assert exact is not None
                assert interval is not None
                dropped = exact.fraction - form.fraction
                low, high = (rounded(raw, dropped, rounding) for raw in (interval.low, interval.high))
                return bool(low < form.lowest or high > form.highest)
            case _:
                return True


def input_limits(model: Model, typed: TypedGraph) -> dict[str, Interval]:
    """The raw numbers that inputs take: those of their declared limits, as they are rounded."""
    places = leaves(typed)
    declared: dict[str, tuple[float, float]] = {}
    if model.measurement_range is not None:
        declared |= {f"z[{j}]": (low, high) for j, (low, high) in enumerate(model.measurement_range)}
    first = model.p - len(model.inputs)
    declared |= {f"u[{first + k}]": (each.low, each.high) for k, each in enumerate(model.inputs)}
    found = {}
    for name, (low, high) in declared.items():
        if name in places:
            form = typed.formats[places[name]]
            assert isinstance(form, Fixed)
            ends = [math.ldexp(end / typed.scales[name], form.fraction) for end in (low, high)]
            whole = of_format(form)
            found[name] = Interval(
                low=max(whole.low, min(whole.high, math.floor(ends[0]))),
                high=min(whole.high, max(whole.low, math.ceil(ends[1]))),
            )
    return found


def _hulls(
    typed: TypedGraph, running: list[Interval | None], starting: list[Interval | None]
) -> dict[int, Interval]:
    """The limits of each number under the commands that use it."""
    cones = (cone(typed.graph, initialise=False), running), (cone(typed.graph, initialise=True), starting)
    hulls: dict[int, Interval] = {}
    for used, found in cones:
        for index in used:
            interval = found[index]
            if interval is not None:
                old = hulls.get(index, interval)
                hulls[index] = Interval(low=min(old.low, interval.low), high=max(old.high, interval.high))
    return hulls


def _summary(part: Part, reach: Reachable | str, mean: Mean | str) -> PartProof:
    return PartProof(
        states=(*part.others, *part.decided),
        covariances=reach.count if isinstance(reach, Reachable) else None,
        unsettled=reach if isinstance(reach, str) else "",
        unbounded=mean if isinstance(mean, str) else "",
    )
