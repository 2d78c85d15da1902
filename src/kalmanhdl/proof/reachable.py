"""Every state that a covariance can take, found by running the engine from the start on all commands.

The covariance of a linear filter does not see the measurements, only which of them there are. In integers it
settles: what tracks had long ago is rounded away, so that the set of its values is finite. A set that the
engine maps into itself under every command is invariant, and what never leaves its format on it never does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.operations import State, StateFlag
from kalmanhdl.numerics.ranges import cone
from kalmanhdl.numerics.typed import Interval, TypedGraph
from kalmanhdl.proof.subgraph import Reduced
from kalmanhdl.simulate.engine import Engine, Trace

Integers = NDArray[np.int64]

# Beyond these, a set is given up, or is not kept step by step.
MAX_NODES, MAX_EDGES, MAX_FLAGS, MAX_BITS = 4_000_000, 150_000, 3, 62
_TOGETHER = 1 << 18


@dataclass(frozen=True, slots=True, kw_only=True)
class Contract:
    """How tracks are driven: ``points`` commands ``initialise`` in a row, then any others.

    No measurement is missed more than ``coast`` times in a row. ``always``: none is missed where a track
    starts; ``before_update``: those of the start's row update it.
    """

    points: int
    coast: int
    always: bool
    before_update: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """The steps between the nodes of a set.

    Edge e leads from node ``source[e]`` to node ``target[e]`` on the measurements ``pattern[e]``;
    ``shown[e, i]`` is what the i-th value to be shown took. The source of a start is -1.
    """

    source: Integers
    target: Integers
    pattern: Integers
    shown: Integers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reachable:
    """A set of ``count`` nodes that every command maps into itself: states, and what was missed in a row.

    ``extremes`` and ``violations`` are by the operations of the reduced graph; ``edges`` is None where
    there are too many.
    """

    count: int
    patterns: tuple[tuple[bool, ...], ...]
    extremes: dict[int, Interval]
    violations: dict[int, int]
    edges: Edges | None


def explore(part: Reduced, flags: Sequence[str], contract: Contract) -> Reachable | str:
    """The reachable states of a reduced graph, or why they were not found."""
    typed = part.typed
    forms = [typed.formats[root] for _, root in typed.graph.states]
    if len(flags) > MAX_FLAGS:
        return f"{len(flags)} measurements make too many patterns"
    wide = [form for form in (*forms, *map(typed.formats.__getitem__, typed.graph.roots)) if form]
    if max(form.width for form in wide) > MAX_BITS:
        return f"it has numbers of more than {MAX_BITS} bits"
    if _start_looks_back(typed):
        return "its start depends on the state before"
    return _Search(part, flags, contract).run()


def _start_looks_back(typed: TypedGraph) -> bool:
    """Whether a start, or what is watched of it, reads a state."""
    watched = tuple((str(v.quantise), v.quantise) for v in typed.violations if v.starting)
    seen = cone(replace(typed.graph, outputs=watched), initialise=True)
    return any(isinstance(typed.graph.operations[k], State | StateFlag) for k in seen)


class _Search:
    """One search in breadth: waves of new nodes, each run through the engine on every pattern.

    A node is a row: the states, how often each measurement was missed in a row, and whether the track has
    just started.
    """

    def __init__(self, part: Reduced, flags: Sequence[str], contract: Contract) -> None:
        self.engine, self.flags, self.contract = Engine.of(part.typed), tuple(flags), contract
        self.names = [name for name, _ in part.typed.graph.states]
        self.outputs = [name for name, _ in part.typed.graph.outputs]
        self.known = {port.name for port in self.engine.program.flags}
        self.patterns = tuple(product((True, False), repeat=len(flags)))
        # The keys of all nodes, sorted, and their numbers.
        self.keys = _keys(np.zeros((0, len(self.names) + len(flags) + 1), np.int64))
        self.numbers = np.zeros(0, np.int64)
        self.steps: list[Edges] | None = []
        self.extremes: dict[int, Interval] = {}
        self.violations: dict[int, int] = dict.fromkeys(self.engine.program.violations, 0)

    def run(self) -> Reachable | str:
        rows, numbers = self._begin()
        while len(rows):
            if len(self.keys) > MAX_NODES:
                return f"more than {MAX_NODES} states are reachable"
            rows, numbers = self._wave(rows, numbers)
        return Reachable(
            count=len(self.keys),
            patterns=self.patterns,
            extremes=self.extremes,
            violations=self.violations,
            edges=_joined(self.steps) if self.steps else None,
        )

    def _begin(self) -> tuple[Integers, Integers]:
        """The nodes of tracks that have just started."""
        found: list[tuple[Integers, Integers]] = []
        for p, pattern in enumerate(self.patterns):
            if self.contract.always and not all(pattern):
                continue
            states = np.zeros((1, len(self.names)), np.int64)
            for _ in range(self.contract.points):
                trace, states = self._engine(states, pattern, initialise=True)
            self._seen(trace)
            missed = [int(self.contract.before_update and not there) for there in pattern]
            rows = np.hstack([states, [missed], [[1]]]).astype(np.int64)
            found.append(self._kept(np.array([-1]), rows, p, trace))
        return _stacked(found)

    def _wave(self, rows: Integers, numbers: Integers) -> tuple[Integers, Integers]:
        found = []
        for begin in range(0, len(rows), _TOGETHER):
            some = slice(begin, begin + _TOGETHER)
            found += [self._stepped(p, rows[some], numbers[some]) for p in range(len(self.patterns))]
        return _stacked(found)

    def _stepped(self, p: int, rows: Integers, numbers: Integers) -> tuple[Integers, Integers]:
        size, pattern = len(self.names), np.array(self.patterns[p], bool)
        missed = np.where(pattern, 0, rows[:, size : size + len(pattern)] + 1)
        allowed = (missed <= self.contract.coast).all(axis=1)
        if not allowed.any():
            return rows[:0], numbers[:0]
        trace, after = self._engine(rows[allowed, :size], self.patterns[p], initialise=False)
        self._seen(trace)
        fresh = np.zeros((len(after), 1), np.int64)
        return self._kept(numbers[allowed], np.hstack([after, missed[allowed], fresh]), p, trace)

    def _engine(
        self, states: Integers, pattern: Sequence[bool], *, initialise: bool
    ) -> tuple[Trace, Integers]:
        shape = (1, len(states))
        given = {"initialise": np.full(shape, initialise)}
        given |= {flag: np.full(shape, there) for flag, there in zip(self.flags, pattern, strict=True)}
        trace = self.engine.run(
            {},
            {name: array for name, array in given.items() if name in self.known},
            initial_state={name: states[:, k] for k, name in enumerate(self.names)},
            monitor=True,
            record_states=False,
        )
        final = [np.asarray(trace.final_state[name], np.int64) for name in self.names]
        return trace, np.stack(final, axis=1)

    def _seen(self, trace: Trace) -> None:
        for index, count in trace.violations.items():
            self.violations[index] += count
        for index, seen in trace.extremes.items():
            old = self.extremes.get(index, seen)
            self.extremes[index] = Interval(low=min(old.low, seen.low), high=max(old.high, seen.high))

    def _kept(self, source: Integers, rows: Integers, p: int, trace: Trace) -> tuple[Integers, Integers]:
        """The rows that are new, with the numbers that they get; all of them are targets of edges."""
        keys, first, back = np.unique(_keys(rows), return_index=True, return_inverse=True)
        place = np.searchsorted(self.keys, keys)
        old = place < len(self.keys)
        old[old] = self.keys[place[old]] == keys[old]
        numbers = np.empty(len(keys), np.int64)
        numbers[old] = self.numbers[place[old]]
        numbers[~old] = len(self.keys) + np.arange(np.count_nonzero(~old))
        self.keys = np.insert(self.keys, place[~old], keys[~old])
        self.numbers = np.insert(self.numbers, place[~old], numbers[~old])
        if self.steps is not None:
            shown = [np.asarray(trace.outputs[name][0], np.int64) for name in self.outputs]
            values = np.stack(shown, axis=1) if shown else np.zeros((len(rows), 0), np.int64)
            target = numbers[back.ravel()]
            self.steps.append(
                Edges(source=source, target=target, pattern=np.full(len(rows), p), shown=values)
            )
            if sum(len(step.source) for step in self.steps) > MAX_EDGES:
                self.steps = None
        return rows[first[~old]], numbers[~old]


def _keys(rows: Integers) -> NDArray[np.void]:
    """Rows as single values that compare."""
    packed = np.ascontiguousarray(rows)
    return packed.view(np.dtype((np.void, packed.dtype.itemsize * packed.shape[1]))).ravel()


def _stacked(found: Sequence[tuple[Integers, Integers]]) -> tuple[Integers, Integers]:
    return np.concatenate([rows for rows, _ in found]), np.concatenate([numbers for _, numbers in found])


def _joined(steps: Sequence[Edges]) -> Edges:
    return Edges(
        source=np.concatenate([step.source for step in steps]),
        target=np.concatenate([step.target for step in steps]),
        pattern=np.concatenate([step.pattern for step in steps]),
        shown=np.concatenate([step.shown for step in steps]),
    )
