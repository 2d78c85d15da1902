"""Command sequences into corners of the state space, found by a search in the engine.

What a linear filter keeps of its covariance depends on the commands alone, and not on the data. Which values
leave their formats together, and how far the covariance goes, random commands seldom try; the engine can.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, product

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.graph.builder import Builder, reachable
from kalmanhdl.graph.operations import Flag, Input, State, StateFlag
from kalmanhdl.numerics.typed import TypedGraph, Violation
from kalmanhdl.simulate.engine import Engine

# States that are looked at from each number of steps, and how many steps that may be.
_BREADTH, _DEPTH = 256, 40
# Of these, so many with the least and with the greatest values of each state.
_ENDS = 8
# Of more measurements than these, all are there, or all but one, or one, or none.
_SUBSETS = 3

Bits = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Walk:
    """The flags of a track's steps, (steps,) each; flags that are not there do not matter."""

    flags: dict[str, Bits]

    def __len__(self) -> int:
        return len(self.flags["initialise"])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """States that no data reach, with the violations that depend on no others, and their flags."""

    states: tuple[str, ...]
    violations: tuple[Violation, ...]
    flags: tuple[str, ...]


def walks(typed: TypedGraph, seed: int) -> tuple[Walk, ...]:
    """A walk to each set of values that leave their formats in one step, and to the ends of each state.

    Each is the first that the search came upon; where no state is free of the data there are none.
    """
    return tuple(chain.from_iterable(_explored(typed, part, seed) for part in _parts(typed)))


def _parts(typed: TypedGraph) -> tuple[_Part, ...]:
    operations, roots = typed.graph.operations, _free_of_data(typed)
    violations = {
        v: needed
        for v in typed.violations
        if (needed := _states_of(typed, v.outside)) is not None and needed and needed <= set(roots)
    }
    groups: list[set[str]] = []
    for linked in (*({n, *(_states_of(typed, r) or ())} for n, r in roots.items()), *violations.values()):
        touched = [group for group in groups if group & linked]
        groups = [group for group in groups if not group & linked] + [linked.union(*touched)]
    found = []
    for group in groups:
        own = tuple(v for v, needed in violations.items() if needed <= group)
        needs = reachable(operations, [*(roots[n] for n in group), *(v.outside for v in own)])
        flags = {op.name for op in map(operations.__getitem__, needs) if isinstance(op, Flag)}
        if "initialise" in flags:
            order = tuple(name for name, _ in typed.graph.states if name in group)
            found.append(_Part(states=order, violations=own, flags=tuple(sorted(flags))))
    return tuple(found)


def _free_of_data(typed: TypedGraph) -> dict[str, int]:
    """The numbers among the states whose next values rest on flags and on each other, with their roots."""
    leaves = {op.name for op in typed.graph.operations if isinstance(op, State)}
    found = {name: root for name, root in typed.graph.states if name in leaves}
    while True:
        needs = {name: _states_of(typed, root) for name, root in found.items()}
        kept = {n: r for n, r in found.items() if (need := needs[n]) is not None and need <= set(found)}
        if len(kept) == len(found):
            return found
        found = kept


def _states_of(typed: TypedGraph, root: int) -> set[str] | None:
    """The states that a value depends on, None where it depends on data."""
    needed = [typed.graph.operations[k] for k in reachable(typed.graph.operations, [root])]
    if any(isinstance(op, Input) for op in needed):
        return None
    return {op.name for op in needed if isinstance(op, State | StateFlag)}


def _explored(typed: TypedGraph, part: _Part, seed: int) -> Iterator[Walk]:
    """Breadth first from the states zero, in which hardware starts; of many states some at random."""
    random, steps = np.random.default_rng(seed), _kinds_of_step(part.flags)
    engine = Engine.of(_reduced(typed, part), optimised=False)
    level = np.zeros((1, len(part.states) + 1), object)
    level_walks: list[tuple[dict[str, bool], ...]] = [()]
    seen_states, seen = {tuple(level[0])}, set[tuple[bool, bool, bytes]]()
    low, high = level[0].copy(), level[0].copy()
    for _ in range(_DEPTH):
        after, events = _stepped(engine, part, steps, level)
        # Ends only move apart: what is within them now is so at its turn.
        beyond = ((after < low) | (after > high)).any(axis=1)
        fresh = []
        for place, (state, event) in enumerate(zip(map(tuple, after), events, strict=True)):
            if event not in seen or (beyond[place] and _beyond(after[place], low, high)):
                seen.add(event)
                low, high = np.minimum(low, after[place]), np.maximum(high, after[place])
                yield _walk(part.flags, _path(level_walks, steps, place))
            if state not in seen_states:
                seen_states.add(state)
                fresh.append(place)
        if not fresh:
            return
        followed = [fresh[k] for k in _followed(after[fresh], random)]
        level, level_walks = after[followed], [_path(level_walks, steps, place) for place in followed]


def _beyond(state: NDArray[np.object_], low: NDArray[np.object_], high: NDArray[np.object_]) -> bool:
    return bool(np.any(state < low) or np.any(state > high))


def _path(
    walks: Sequence[tuple[dict[str, bool], ...]], steps: Sequence[dict[str, bool]], place: int
) -> tuple[dict[str, bool], ...]:
    """The steps to the state at a place among those after every kind of step from every walk's end."""
    return *walks[place // len(steps)], steps[place % len(steps)]


def _followed(fresh: NDArray[np.object_], random: np.random.Generator) -> list[int]:
    """The states that the search goes on from: those with the least and the greatest values, and some others.

    Left to chance, nobody would go on predicting until the covariance leaves its formats.
    """
    ends: list[int] = []
    for column in fresh[:, :-1].T:
        order = np.argsort(column, kind="stable")
        ends += [*order[:_ENDS].tolist(), *order[-_ENDS:].tolist()]
    others = random.permutation(len(fresh))[:_BREADTH].tolist()
    return list(dict.fromkeys([*ends, *others]))[:_BREADTH]


def _kinds_of_step(flags: Sequence[str]) -> list[dict[str, bool]]:
    """The commands: a start, and every other step with some measurements."""
    seen = [name for name in flags if name != "initialise"]
    some = product((False, True), repeat=len(seen)) if len(seen) <= _SUBSETS else _few(len(seen))
    others = [{"initialise": False, **dict(zip(seen, row, strict=True))} for row in some]
    return [{"initialise": True, **dict.fromkeys(seen, True)}, *others]


def _few(count: int) -> Iterator[tuple[bool, ...]]:
    for value in (False, True):
        yield (value,) * count
        for one in range(count):
            yield tuple((k == one) != value for k in range(count))


def _reduced(typed: TypedGraph, part: _Part) -> TypedGraph:
    """The graph of the states of a part, that puts out which of its values leave their formats."""
    builder, old = Builder(), typed.graph
    builder.operations, builder.origins = list(old.operations), list(old.origins)
    states = [(name, root) for name, root in old.states if name in part.states]
    outputs = [(f"outside[{k}]", v.outside) for k, v in enumerate(part.violations)]
    kept = sorted(reachable(old.operations, [index for _, index in (*states, *outputs)]))
    return TypedGraph(
        graph=builder.graph(states, outputs),
        formats=tuple(typed.formats[k] for k in kept),
        intervals=tuple(typed.intervals[k] for k in kept),
        division=typed.division,
        division_rounding=typed.division_rounding,
        violations=(),
        scales={},
    )


def _stepped(
    engine: Engine, part: _Part, steps: list[dict[str, bool]], level: NDArray[np.object_]
) -> tuple[NDArray[np.object_], list[tuple[bool, bool, bytes]]]:
    """Every kind of step from every state: the states after it, and which values left their formats.

    The last column of a state tells whether a value has left its format since the track started.
    """
    before = np.repeat(level, len(steps), axis=0)
    flags = {name: np.array([[step[name] for step in steps] * len(level)]) for name in part.flags}
    first = {name: before[:, k] for k, name in enumerate(part.states)}
    trace = engine.run({}, flags, initial_state=first, record_states=False)
    starts = flags["initialise"][0]
    left = np.zeros((len(before), len(part.violations)), bool)
    for k, violation in enumerate(part.violations):
        matters = np.where(starts, violation.starting, violation.running)
        left[:, k] = trace.outputs[f"outside[{k}]"][0].astype(bool) & matters
    sticky = left.any(axis=1) | (~starts & before[:, -1].astype(bool))
    after = np.column_stack([*(trace.final_state[name].astype(object) for name in part.states), sticky])
    events = [
        (bool(start), bool(was), row.tobytes())
        for start, was, row in zip(starts, before[:, -1], left, strict=True)
    ]
    return after.astype(object), events


def _walk(flags: Sequence[str], path: Sequence[dict[str, bool]]) -> Walk:
    return Walk(flags={name: np.array([step[name] for step in path]) for name in flags})
