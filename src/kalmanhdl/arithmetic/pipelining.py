"""Where the registers of a pipelined operator lie."""

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
    """The inner boundaries of at most ``stages`` stages whose longest is the shortest possible."""
    sums = {sum(weights[a:b]) for a in range(len(weights)) for b in range(a + 1, len(weights) + 1)}
    for limit in sorted(sums):
        cuts = _filled(weights, limit)
        if cuts is not None and len(cuts) < stages:
            return cuts
    return ()


def _filled(weights: Sequence[float], limit: float) -> tuple[int, ...] | None:
    """Boundaries of stages filled up to a limit one after the other; None if a step is longer."""
    cuts: list[int] = []
    stage = 0.0
    for index, weight in enumerate(weights):
        if weight > limit:
            return None
        if stage + weight > limit:
            cuts.append(index)
            stage = 0.0
        stage += weight
    return tuple(cuts)
