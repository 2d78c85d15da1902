"""From the best uniform word length to the fewest bits: how much each signal bears, then steepest descent.

What is added by rounding different signals adds up, and falls to a quarter with every bit. So the widths at
which each signal alone uses the same share, all made wider by as much, are near the best choice. From there
bits are taken where the error grows least for what they save, and exchanged: a bit is given back where that
helps most, and others are taken for it.
"""

from collections.abc import Callable

import numpy as np

from kalmanhdl.errors import FormatError
from kalmanhdl.explore.evaluator import MOST_BITS, Evaluator, Widths

Progress = Callable[[str], None]

_LEAST = 3
# Bits beyond the uniform word length that leave a signal's own rounding to be seen.
_PLENTY = 6
_EXCHANGES = 12
_TRIES = 3
# Candidates after which nothing further is exchanged, and work (operations) after which it is so as well:
# large filters end within two minutes.
_BUDGET, _WORK = 4000, 4e10
_CONSTANT_STEP = 6
_FIRST_SHARE, _LEAST_SHARE = 0.25, 1 / 16
# How far around the chosen widths the front is looked at.
_AROUND = range(-6, 9)


def fit_ranges(evaluator: Evaluator) -> None:
    """Bits above the binary point until nothing is clamped at a width that has plenty."""
    program = evaluator.program
    for _ in range(24):
        names = {slot: v.name for v in evaluator.variables for slot in v.slots}
        forms = evaluator.placed(evaluator.uniform(MOST_BITS))
        run = evaluator.engine.run(forms, evaluator.constant_width, evaluator.wide)
        clamped = run.clamped + sum(
            case.engine.run(forms, evaluator.constant_width, case.drive).clamped for case in evaluator.cases
        )
        places = [program.steps[k].slot for k in np.flatnonzero(clamped).tolist()]
        short = {names[slot] for slot in places if slot in names}
        if not short:
            return
        widen_ranges(evaluator, short)


def widen_ranges(evaluator: Evaluator, names: set[str]) -> None:
    """One more bit above the binary point."""
    for name in names:
        evaluator.headroom[name] = evaluator.headroom.get(name, 0) + 1
    evaluator.place()


def fit_constants(evaluator: Evaluator, target: float) -> None:
    """More bits for the model's constants, until the widest words meet the target. Raises FormatError."""
    own = evaluator.constant_width
    for constant in range(own, max(own, MOST_BITS) + 1, _CONSTANT_STEP):
        if constant != own:
            evaluator.use(evaluator.base, constant)
        if evaluator.point(evaluator.uniform(MOST_BITS)).share <= target:
            return
    raise FormatError(f"no word length up to {MOST_BITS} bits meets the tolerance: allow more error")


def best_uniform(evaluator: Evaluator, target: float) -> int:
    """The least word length within the target. Raises FormatError where there is none."""
    fit_constants(evaluator, target)
    lengths = list(range(_LEAST, MOST_BITS + 1))
    for begin in range(0, len(lengths), 4):
        some = lengths[begin : begin + 4]
        points = evaluator.points([evaluator.uniform(length) for length in some])
        for length, point in zip(some, points, strict=True):
            if point.share <= target:
                return length
    raise AssertionError(f"{MOST_BITS} bits met the target before")


def balanced(evaluator: Evaluator, uniform: int, target: float) -> Widths:
    """Widths at which all signals use about the same share of the target, and together not more than it."""
    plenty = min(uniform + _PLENTY, MOST_BITS)
    low, high = evaluator.uniform(0), evaluator.uniform(plenty)
    while (high - low > 1).any():
        middle = (low + high) // 2
        trials = [_with(evaluator.uniform(plenty), k, int(w)) for k, w in enumerate(middle)]
        fits = np.array([p.share <= target / 4 for p in evaluator.points(trials)])
        high, low = np.where(fits, middle, high), np.where(fits, low, middle)
    for offset in range(plenty):
        widths = np.minimum(high + offset, plenty)
        if evaluator.point(widths).share <= target:
            return widths
    return evaluator.uniform(uniform)


def widened(evaluator: Evaluator, widths: Widths, target: float) -> Widths:
    """Widths with as many bits more everywhere as the target needs. Raises FormatError."""
    while evaluator.point(widths).share > target:
        if widths.max() > 2 * MOST_BITS:
            raise FormatError("these tracks meet the tolerance at no word length: allow more error")
        widths = widths + 1
    return widths


def descended(evaluator: Evaluator, widths: Widths, target: float, progress: Progress) -> Widths:
    """Bits taken until none can be; the share of signals that lose one shrinks from round to round."""
    share, open_ = _FIRST_SHARE, [k for k in range(len(widths)) if widths[k] > 1]
    while True:
        here = evaluator.point(widths)
        trials = {k: _with(widths, k, int(widths[k]) - 1) for k in open_ if widths[k] > 1}
        points = dict(zip(trials, evaluator.points(list(trials.values())), strict=True))
        # What a signal cannot spare now it can spare later even less.
        open_ = [k for k, p in points.items() if p.share <= target and p.cost <= here.cost]
        if not open_:
            return widths
        ranked = sorted(
            open_,
            key=lambda k: (
                (max(points[k].share - here.share, 0.0) + 1e-9) / max(here.cost - points[k].cost, 1e-3),
                k,
            ),
        )
        progress(f"{here.bits} bits, {here.share:.0%} of what is allowed, {evaluator.candidates} candidates")
        taken = max(1, int(len(ranked) * share))
        while True:
            joint = widths.copy()
            joint[ranked[:taken]] -= 1
            if taken == 1 or evaluator.point(joint).share <= target:
                break
            taken = max(1, taken // 2)
        share = min(share, max(taken / len(ranked), _LEAST_SHARE))
        widths = joint


def exchanged(evaluator: Evaluator, widths: Widths, target: float, progress: Progress) -> Widths:
    """A bit given where it lowers the error most, and bits taken elsewhere for it, while that pays."""
    best, point = widths, evaluator.point(widths)
    for _ in range(_EXCHANGES):
        if _spent(evaluator):
            return best
        given = [_with(best, k, int(best[k]) + 1) for k in range(len(best))]
        shares = [each.share for each in evaluator.points(given)]
        order = sorted(range(len(given)), key=lambda k: (shares[k], k))
        improved = False
        for k in order[:_TRIES]:
            other = descended(evaluator, given[k], target, progress)
            found = evaluator.point(other)
            if found.cost < point.cost:
                best, point, improved = other, found, True
                break
        if not improved:
            return best
    return best


def look_around(evaluator: Evaluator, widths: Widths) -> None:
    """What the same choice with more or fewer bits everywhere is worth, and uniform words."""
    shifted = [np.maximum(widths + by, 1) for by in _AROUND]
    evaluator.points([each for each in shifted if each.max() <= MOST_BITS])


def _spent(evaluator: Evaluator) -> bool:
    return evaluator.candidates > _BUDGET or evaluator.candidates * evaluator.work > _WORK


def _with(widths: Widths, k: int, width: int) -> Widths:
    result = widths.copy()
    result[k] = width
    return result
