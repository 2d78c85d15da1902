"""How far a value can be driven: the worst input on the worst path through a set of reachable covariances.

A value after a step is a row times the states before it, and these are what the steps before made of theirs:
going back along a path, a row w becomes w A, and every step adds |w B| times the reach of its inputs. Where
the filter forgets, what is left of w after some steps is small, and is closed with a box that holds the
states. Paths are followed where they could be the worst; what is not followed is closed where it is, so
that the bound holds whenever the search ends.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Paths followed at a time, kept at most, and rounds; what is left of a path's row that may be closed.
_AT_ONCE, _KEPT, _ROUNDS, _CLOSED = 20_000, 400_000, 100, 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Steps:
    """Running steps e: x' = A[e] x + offset[e] + what is within reach[e], where x are k states.

    ``offset`` (E, k) holds the middles of inputs and errors, ``driven`` (E, k, i) what the inputs do from
    their middles to their ends, ``reach`` (E, k) what errors do. ``first`` (nodes + 1,) and ``order`` give
    the edges that lead to a node, ``fresh`` (nodes,) those nodes that a start leads to.
    """

    A: Array
    offset: Array
    driven: Array
    reach: Array
    source: Integers
    first: Integers
    order: Integers
    fresh: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Limits (k,) of states."""

    low: Array
    high: Array

    def greatest(self, rows: Array) -> Array:
        """The greatest value of rows (..., k) times a state in the box."""
        return np.asarray(rows @ (self.low + self.high) / 2 + np.abs(rows) @ (self.high - self.low) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """Ends of paths: a value is at most ``total`` + ``rows`` times the state of node ``node``."""

    total: Array
    rows: Array
    node: Integers

    def bound(self, steps: Steps, box: Box, start: Box) -> Array:
        """The greatest value by each path, where states are in a box, and in another where tracks start."""
        return self.total + np.where(
            steps.fresh[self.node], start.greatest(self.rows), box.greatest(self.rows)
        )

    def taken(self, chosen: NDArray[np.bool_] | Integers) -> "Front":
        """Some of the paths."""
        return Front(self.total[chosen], self.rows[chosen], self.node[chosen])

    def with_(self, other: "Front") -> "Front":
        """These paths and others."""
        return Front(
            np.concatenate([self.total, other.total]),
            np.concatenate([self.rows, other.rows]),
            np.concatenate([self.node, other.node]),
        )


def worst(front: Front, steps: Steps, box: Box, start: Box) -> Front:
    """The paths behind a front, followed where they could be the worst. A bound over them is one over it."""
    for _ in range(_ROUNDS):
        front = _contending(front, steps, box, start)
        bounds = front.bound(steps, box, start)
        follow = np.flatnonzero(~steps.fresh[front.node])
        left = np.abs(front.rows[follow]) @ (box.high - box.low)
        follow = follow[left > _CLOSED * np.abs(bounds.max())]
        follow = follow[np.argsort(-bounds[follow], kind="stable")[:_AT_ONCE]]
        if not len(follow) or len(front.node) > _KEPT:
            break
        rest = np.ones(len(front.node), bool)
        rest[follow] = False
        front = front.taken(rest).with_(_followed(front.taken(follow), steps))
    return front


def _contending(front: Front, steps: Steps, box: Box, start: Box) -> Front:
    """The paths that could be the worst; one that leads nowhere stands for all below the least of it."""
    opposite = Front(-front.total, -front.rows, front.node)
    least = float(-opposite.bound(steps, box, start).min())
    kept = front.taken(front.bound(steps, box, start) > least)
    floor = Front(np.array([least]), np.zeros((1, front.rows.shape[1])), front.node[:1])
    return kept.with_(floor)


def _followed(front: Front, steps: Steps) -> Front:
    counts = steps.first[front.node + 1] - steps.first[front.node]
    path = np.repeat(np.arange(len(front.node)), counts)
    within = np.arange(len(path)) - np.repeat(np.cumsum(counts) - counts, counts)
    edge = steps.order[steps.first[front.node[path]] + within]
    rows = front.rows[path]
    total = front.total[path] + (rows * steps.offset[edge]).sum(axis=1)
    total += np.abs(np.einsum("pk,pki->pi", rows, steps.driven[edge])).sum(axis=1)
    total += (np.abs(rows) * steps.reach[edge]).sum(axis=1)
    return Front(total, np.einsum("pk,pkl->pl", rows, steps.A[edge]), steps.source[edge])
