"""From the best uniform word length to the fewest bits: how much each signal bears, then steepest descent.

What is added by rounding different signals adds up, and falls to a quarter with every bit. So the widths at
which each signal alone uses the same share, all made wider by as much, are near the best choice. From there
bits are taken where the error grows least for what they save, and exchanged: a bit is given back where that
helps most, and others are taken for it.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.errors import FormatError
from kalmanhdl.explore.evaluator import MOST_BITS, Evaluator, Widths
from kalmanhdl.explore.tolerance import SHIFT

Progress = Callable[[str], None]

_LEAST, _MOST_HEADROOM = 3, 24
# Bits beyond the uniform word length that leave a signal's own rounding to be seen.
_PLENTY = 6
_EXCHANGES = 12
_TRIES = 3
# Candidates after which nothing further is exchanged, and work (operations) after which it is so as well:
# large filters end within two minutes.
_BUDGET, _WORK = 4000, 4e10
_CONSTANT_STEP = 6
# How far around the chosen widths the front is looked at.
_AROUND = range(-6, 9)


def fit_ranges(evaluator: Evaluator, widths: Widths | None = None) -> None:
    """Bits above the binary point until no value lacks them at widths that have plenty, or at those given."""
    program = evaluator.program
    for _ in range(_MOST_HEADROOM):
        names = {slot: v.name for v in evaluator.variables for slot in v.slots}
        forms = evaluator.placed(evaluator.uniform(MOST_BITS) if widths is None else widths)
        beyond = sum(
            case.engine.run(forms, evaluator.constant_width, case.drive).beyond
            for case in (evaluator.wide, *evaluator.cases)
        )
        places = [program.steps[k].slot for k in np.flatnonzero(beyond).tolist()]
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
    raise FormatError(_hopeless(evaluator))


def _hopeless(evaluator: Evaluator) -> str:
    """Why no word length does, by what the widest words are worth, and what helps."""
    point, division = evaluator.point(evaluator.uniform(MOST_BITS)), evaluator.base.division
    found = []
    if not np.isnan(point.error):
        found.append(f"errors grow by {point.error:.2%}")
    if not np.isnan(point.shift):
        found.append(f"NEES or NIS moves by {point.shift:.2f} of half its band, of which {SHIFT} are allowed")
    remedy = "allow more error"
    if isinstance(division, TableNewton):
        remedy = (
            f"give [numerics] division a table of more than {division.index_bits} bits or a Newton step more"
        )
    return f"no word length up to {MOST_BITS} bits does, by which {' and '.join(found)}: {remedy}"


def best_uniform(evaluator: Evaluator, target: float) -> int:
    """The least word length within the target. Raises FormatError where there is none."""
    lengths = list(range(_LEAST, MOST_BITS + 1))
    for begin in range(0, len(lengths), 4):
        some = lengths[begin : begin + 4]
        points = evaluator.points([evaluator.uniform(length) for length in some])
        for length, point in zip(some, points, strict=True):
            if point.share <= target:
                return length
    raise FormatError(_hopeless(evaluator))


def balanced(evaluator: Evaluator, uniform: int, target: float, alone: Widths | None = None) -> Widths:
    """The widths at which each signal, among words with bits to spare, uses a quarter of the target.

    ``alone`` are what this was on some of the tracks, where the search for it begins.
    """
    plenty = evaluator.uniform(min(uniform + _PLENTY, MOST_BITS))
    low, high = evaluator.uniform(0), plenty
    if alone is not None:
        fits = _fit(evaluator, plenty, np.minimum(alone, plenty), target)
        low = np.where(fits, alone - 1, alone)
        high = np.where(fits, np.minimum(alone, plenty), plenty)
    while (high - low > 1).any():
        middle = np.where(high - low > 1, (low + high) // 2, high)
        fits = _fit(evaluator, plenty, middle, target)
        high, low = np.where(fits, middle, high), np.where(fits, low, middle)
    return high


def _fit(evaluator: Evaluator, plenty: Widths, widths: Widths, target: float) -> NDArray[np.bool_]:
    """Whether each width by itself leaves three quarters of the target to others."""
    trials = [_with(plenty, k, int(width)) for k, width in enumerate(widths)]
    return np.array([p.share <= target / 4 for p in evaluator.points(trials)])


def together(evaluator: Evaluator, alone: Widths, uniform: int, target: float) -> Widths:
    """Balanced widths with as many bits more everywhere as all of them together need."""
    most = min(uniform + _PLENTY, MOST_BITS)
    for offset in range(most):
        widths = np.minimum(alone + offset, most)
        if evaluator.point(widths).share <= target:
            return widths
    return evaluator.uniform(uniform)


def descended(
    evaluator: Evaluator, widths: Widths, target: float, progress: Progress, least: Widths | None = None
) -> list[Widths]:
    """Bits taken until none can be, of many signals at once where their errors together allow it.

    No signal gets narrower than ``least``. All choices on the way, from the first to the last.
    """
    way, floor = [widths], evaluator.uniform(1) if least is None else least
    open_ = [k for k in range(len(widths)) if widths[k] > floor[k]]
    while True:
        here = evaluator.point(widths)
        trials = {k: _with(widths, k, int(widths[k]) - 1) for k in open_ if widths[k] > floor[k]}
        points = dict(zip(trials, evaluator.points(list(trials.values())), strict=True))
        # What a signal cannot spare now it can spare later even less.
        open_ = [k for k, p in points.items() if p.share <= target and p.cost <= here.cost]
        if not open_:
            return way
        grown = {k: max(points[k].share - here.share, 0.0) + 1e-9 for k in open_}
        ranked = sorted(open_, key=lambda k: (grown[k] / max(here.cost - points[k].cost, 1e-3), k))
        progress(f"{here.bits} bits, {here.share:.0%} of what is allowed, {evaluator.candidates} candidates")
        # What rounding adds adds up. Half of what is left is given away at once, the cheapest bits first.
        sums = np.cumsum([grown[k] for k in ranked])
        taken = max(1, int(np.searchsorted(sums, (target - here.share) / 2)))
        while taken > 1 and evaluator.point(_less(widths, ranked[:taken])).share > target:
            taken //= 2
        widths = _less(widths, ranked[:taken])
        way.append(widths)


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
            other = descended(evaluator, given[k], target, progress)[-1]
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


def _less(widths: Widths, fewer: list[int]) -> Widths:
    result = widths.copy()
    result[fewer] -= 1
    return result


def _with(widths: Widths, k: int, width: int) -> Widths:
    result = widths.copy()
    result[k] = width
    return result
