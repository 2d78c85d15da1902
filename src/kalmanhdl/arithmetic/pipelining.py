"""Where the registers of a pipelined operator lie."""

import math
from collections.abc import Sequence
from itertools import pairwise


def register_places(weights: Sequence[float], registers: int) -> tuple[int, ...]:
    """How many registers stand before each step of a chain, and after the last.

    ``weights`` are the delays of the steps. The registers cut the chain so that its longest stage is
    as short as possible; those that no cut needs stand at its end.
    """
    places = [0] * (len(weights) + 1)
    cuts = _cuts(weights, registers + 1)
    for cut in cuts:
        places[cut] += 1
    places[-1] += registers - len(cuts)
    return tuple(places)


def longest_stage(weights: Sequence[float], registers: int) -> float:
    """The delay of the longest stage when ``register_places`` has cut the chain."""
    cuts = (0, *_cuts(weights, registers + 1), len(weights))
    return max((sum(weights[a:b]) for a, b in pairwise(cuts)), default=0.0)


def _cuts(weights: Sequence[float], stages: int) -> tuple[int, ...]:
    """The inner boundaries of at most ``stages`` stages whose longest is the shortest possible.

    Stages are filled up to a limit, and the least limit that suffices is searched by halves: filled to less
    than the next longer stage, they would be the same.
    """
    low, high = max(weights, default=0), sum(weights)
    cuts: tuple[int, ...] = ()
    while low < high:
        # Between neighbouring numbers there is no half.
        limit = min((low + high) / 2, math.nextafter(high, low))
        filled, longest, longer = _filled(weights, limit)
        if len(filled) < stages:
            cuts, high = filled, longest
        else:
            low = longer
    return cuts


def _filled(weights: Sequence[float], limit: float) -> tuple[tuple[int, ...], float, float]:
    """Boundaries of stages filled up to a limit one after the other, no step being longer than it.

    Also the longest of them, and the least that one of them would be with the step after it.
    """
    cuts: list[int] = []
    stage, longest, longer = 0.0, 0.0, float("inf")
    for index, weight in enumerate(weights):
        if stage + weight > limit:
            cuts.append(index)
            longer = min(longer, stage + weight)
            stage = 0.0
        stage += weight
        longest = max(longest, stage)
    return tuple(cuts), longest, longer
