"""Number formats chosen by the tool: the fewest bits, or the least area, within a tolerance.

Steepest descent from the best uniform word length: bits are taken where the error grows least for what they
save, from many signals at once at first, from single ones at the end. Then exchanges: a bit is given back
where that helps most, and others are taken for it. Every candidate is a run of the format engine; what is
chosen is confirmed by the bit-exact engine on tracks that the search has not seen.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.design import Design
from kalmanhdl.errors import FormatError
from kalmanhdl.explore.area import estimated_luts
from kalmanhdl.explore.choice import Variable, bits_of, place_forms, specification_of, variables_of
from kalmanhdl.explore.format_engine import Drive, FormatEngine, Run
from kalmanhdl.explore.program import Program, program_of
from kalmanhdl.explore.tracks import (
    Judged,
    drawn_plots,
    drive_of,
    from_the_start,
    joined,
    judged,
    split,
    usual_steps,
)
from kalmanhdl.numerics.integers import in_reals, in_units, numbers
from kalmanhdl.numerics.ranges import Ranges, observed
from kalmanhdl.numerics.signals import signal_of
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.side_by_side import simulate
from kalmanhdl.target import device
from kalmanhdl.target.device import Device
from kalmanhdl.validation import InvalidValueError

Widths = NDArray[np.int64]
Progress = Callable[[str], None]

TRACKS = 64
_LEAST, _MOST = 3, 44
# What is chosen on some tracks is to hold on others: so much of the tolerance is used on those.
_MARGIN = 0.8
_ATTEMPTS = 6
_EXCHANGES = 12
# Candidates after which nothing further is exchanged, so that large filters end within two minutes.
_BUDGET = 4000
_CONSTANT_STEP = 6
_LEAST_SHARE = 1 / 16
# Tracks on which a choice failed that join those of the search.
_WORST = 16
_WIDE = 16


class Objective(Enum):
    """What is to be small: the sum of all widths, or LUTs and multiplier blocks, as they are estimated."""

    BITS = "bits"
    AREA = "area"


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A choice of formats: its bits, its cost (bits or LUTs), and the relative excess of the error."""

    bits: int
    cost: float
    error: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What a search found.

    ``uniform`` is the least word length that meets the tolerance if all signals have it; ``point`` and
    ``uniform_point`` are as on the tracks of the search. ``unseen`` is the greatest excess of a state's
    error, by the bit-exact engine, on tracks that the search did not see, ``unseen_data`` that on the
    user's data. ``front`` is sorted by cost.
    """

    specification: FixedSpecification
    variables: tuple[Variable, ...]
    widths: Widths
    point: Point
    uniform: int
    uniform_point: Point
    unseen: float
    unseen_data: float | None
    front: tuple[Point, ...]
    candidates: int


@dataclass(slots=True)
class _Evaluator:
    """Errors and costs of widths, each found once; every candidate that was ever run is in ``known``."""

    engine: FormatEngine
    base: FixedSpecification
    variables: tuple[Variable, ...]
    sets: tuple[tuple[Judged, Drive], ...]
    # Many more tracks, of which only is asked how far values reach.
    wide: Drive
    scales: NDArray[np.float64]
    objective: Objective
    part: Device
    pool: ThreadPoolExecutor
    known: dict[bytes, Point] = field(default_factory=dict)
    forms: NDArray[np.void] = field(init=False)

    def __post_init__(self) -> None:
        self.forms = self.engine.forms(self.base)

    def use(self, base: FixedSpecification, constant: int) -> None:
        """Other formats for what is not chosen; what was known no longer holds."""
        self.base = replace(base, classes=base.classes | {"constant": constant})
        self.forms = self.engine.forms(self.base)
        self.known.clear()

    def points(self, many: list[Widths]) -> list[Point]:
        """The points of candidates, in parallel."""
        new = {w.tobytes(): w for w in many if w.tobytes() not in self.known}
        for key, point in zip(new, self.pool.map(self._point, new.values()), strict=True):
            self.known[key] = point
        return [self.known[w.tobytes()] for w in many]

    def runs(self, widths: Widths) -> list[Run]:
        """The runs of one candidate on all tracks."""
        forms = place_forms(self.forms, self.engine.program, self.variables, widths)
        return [self.engine.run(forms, _constant_width(self.base), drive) for _, drive in self.sets]

    def _point(self, widths: Widths) -> Point:
        error, bits = 0.0, bits_of(self.variables, widths)
        cost = float(bits)
        for (on, _), run in zip(self.sets, self.runs(widths), strict=True):
            if self.objective is Objective.AREA:
                cost = estimated_luts(self.engine.program, run, self.part)
            x = np.moveaxis(run.outputs, 0, -1) * self.scales
            excess = float(np.nanmax(on.excess(x)))
            clamped = bool(run.clamped.any())
            error = np.inf if clamped or not np.isfinite(excess) else max(error, excess)
        return Point(bits=bits, cost=cost, error=error)


def search(
    design: Design,
    *,
    tolerance: float = 0.01,
    objective: Objective = Objective.BITS,
    data: Plots | None = None,
    seed: int = 1,
    steps: int | None = None,
    tracks: int = TRACKS,
    workers: int = 2,
    progress: Progress = lambda _: None,
) -> Found:
    """Formats for a design within a relative excess of its root mean square errors.

    Deterministic for a seed. Raises FormatError where no word length up to 44 bits meets the tolerance,
    DesignError where the design is not in fixed point, ToolError without a C compiler.
    """
    base = _cleared(design.fixed_point)
    steps = steps or usual_steps(design.model)
    progress("tracing the filter and drawing tracks")
    reals = in_reals(design.model, design.algorithm, base)
    ranges = reals.ranges
    if data is not None:
        seen = observed(reals.graph, reals.model, in_units(from_the_start(design.model, data), reals.scaling))
        ranges = _joined(ranges, seen)
    program = program_of(reals.graph, ranges)
    filter_ = design.algorithm(design.model)
    plots = [drawn_plots(design.model, base.coast, steps, tracks, seed)]
    unseen = [drawn_plots(design.model, base.coast, steps, 2 * tracks, seed + 1)]
    many = drawn_plots(design.model, base.coast, steps, _WIDE * tracks, seed + 2)
    if data is not None:
        chosen_by, judged_by = split(data)
        plots.append(chosen_by)
        unseen.append(judged_by)
    sets = [judged(design.model, filter_, each) for each in plots]
    checks = [judged(design.model, filter_, each) for each in unseen]
    n = design.model.n
    with ThreadPoolExecutor(workers) as pool:
        evaluator = _Evaluator(
            engine=FormatEngine.of(program, base, [f"x[{i}]" for i in range(n)]),
            base=base,
            variables=(),
            sets=tuple((each, drive_of(program, reals.scaling, each)) for each in sets),
            wide=drive_of(program, reals.scaling, judged(design.model, filter_, many)),
            scales=np.array([reals.scales[f"x[{i}]"] for i in range(n)]),
            objective=objective,
            part=device(design.target.device, design.target.grade),
            pool=pool,
        )
        extra: dict[str, int] = {}
        target = tolerance * _MARGIN
        found = _searched(evaluator, program, extra, target, progress)
        for attempt in range(_ATTEMPTS):
            progress("confirming with the bit-exact engine on tracks that were not seen")
            result, failed, error = _confirmed(design, found, checks, tolerance, evaluator)
            if result is not None:
                return result
            # The tracks on which it failed are seen from now on, and others take their place.
            sets[0] = judged(design.model, filter_, joined(sets[0].plots, failed))
            evaluator.sets = tuple((each, drive_of(program, reals.scaling, each)) for each in sets)
            fresh = drawn_plots(design.model, base.coast, steps, 2 * tracks, seed + 3 + attempt)
            checks[0] = judged(design.model, filter_, fresh)
            # By how much it failed, with a margin, within reason where a filter broke down.
            target *= min(0.85, max(0.9 * tolerance / error, 0.25)) if error > 0 else 0.85
            found = _again(evaluator, program, extra, found, target, progress)
    raise FormatError(f"{design.name}: formats that hold on tracks not seen were not found: allow more error")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Descent:
    variables: tuple[Variable, ...]
    base: FixedSpecification
    widths: Widths
    uniform: int


def _searched(
    evaluator: _Evaluator, program: Program, extra: dict[str, int], target: float, progress: Progress
) -> _Descent:
    """Range bits that hold on the tracks, the best uniform word length, descent and exchanges."""
    _fit_ranges(evaluator, program, extra)
    progress("finding the best uniform word length")
    uniform = _best_uniform(evaluator, target)
    evaluator.use(replace(evaluator.base, width=uniform), _constant_width(evaluator.base))
    widths = _widened(evaluator, np.full(len(evaluator.variables), uniform, np.int64), target)
    widths = _descended(evaluator, widths, target, progress)
    best = _exchanged(evaluator, widths, target, progress)
    # The front beyond the tolerance: what fewer bits would cost.
    for more in (2.0, 4.0):
        if len(evaluator.known) > _BUDGET:
            break
        widths = _descended(evaluator, widths, target * more, progress)
    return _Descent(variables=evaluator.variables, base=evaluator.base, widths=best, uniform=uniform)


def _again(
    evaluator: _Evaluator,
    program: Program,
    extra: dict[str, int],
    found: _Descent,
    target: float,
    progress: Progress,
) -> _Descent:
    """A choice that did not hold, with more bits everywhere, and the descent from there."""
    _fit_ranges(evaluator, program, extra)
    widths = _widened(evaluator, found.widths + 1, target)
    widths = _descended(evaluator, widths, target, progress)
    return replace(found, variables=evaluator.variables, widths=widths)


def _widened(evaluator: _Evaluator, widths: Widths, target: float) -> Widths:
    while evaluator.points([widths])[0].error > target:
        if widths.max() > 2 * _MOST:
            raise FormatError("these tracks meet the tolerance at no word length: allow more error")
        widths = widths + 1
    return widths


def _fit_ranges(evaluator: _Evaluator, program: Program, extra: dict[str, int]) -> None:
    """Bits above the binary point until nothing is clamped at a width that has plenty."""
    for _ in range(16):
        evaluator.variables = variables_of(program, extra)
        evaluator.known.clear()
        names = {slot: v.name for v in evaluator.variables if v.signal for slot in v.slots}
        wide = np.full(len(evaluator.variables), _MOST, np.int64)
        forms = place_forms(evaluator.forms, program, evaluator.variables, wide)
        run = evaluator.engine.run(forms, _constant_width(evaluator.base), evaluator.wide)
        clamped = run.clamped + sum(each.clamped for each in evaluator.runs(wide))
        places = np.flatnonzero(clamped)
        short = {names[program.steps[k].slot] for k in places.tolist() if program.steps[k].slot in names}
        if not short:
            return
        for name in short:
            extra[name] = extra.get(name, 0) + 1


def _best_uniform(evaluator: _Evaluator, target: float) -> int:
    """The least word length within the target; constants get more bits if they need them."""
    lengths, count = list(range(_LEAST, _MOST + 1)), len(evaluator.variables)
    own = _constant_width(evaluator.base)
    for constant in range(own, max(own, _MOST) + 1, _CONSTANT_STEP):
        evaluator.use(evaluator.base, constant)
        if evaluator.points([np.full(count, _MOST, np.int64)])[0].error > target:
            continue
        for begin in range(0, len(lengths), 4):
            some = lengths[begin : begin + 4]
            points = evaluator.points([np.full(count, length, np.int64) for length in some])
            for length, point in zip(some, points, strict=True):
                if point.error <= target:
                    return length
    raise FormatError(f"no word length up to {_MOST} bits meets the tolerance: allow more error")


def _descended(evaluator: _Evaluator, widths: Widths, target: float, progress: Progress) -> Widths:
    """Bits taken until none can be; the share of signals that lose one shrinks from round to round."""
    share = 0.5
    while True:
        here = evaluator.points([widths])[0]
        trials = [_changed(widths, k, -1) for k in range(len(widths)) if widths[k] > 1]
        points = evaluator.points(trials)
        ranked = sorted(
            (
                (max(p.error - here.error, 0.0) + 1e-9) / max(here.cost - p.cost, 1e-3),
                k,
            )
            for k, p in enumerate(points)
            if p.error <= target and p.cost <= here.cost
        )
        if not ranked:
            return widths
        progress(f"{here.bits} bits, error {100 * here.error:.3f} %, {len(evaluator.known)} candidates")
        taken = max(1, int(len(ranked) * share))
        while True:
            chosen = [trials[k] for _, k in ranked[:taken]]
            joint = widths + np.sum([trial - widths for trial in chosen], axis=0)
            if taken == 1 or evaluator.points([joint])[0].error <= target:
                break
            taken = max(1, taken // 2)
        # Not too small, as long as all signals together have bits to spare.
        share = min(share, max(taken / len(ranked), _LEAST_SHARE))
        widths = joint


def _exchanged(evaluator: _Evaluator, widths: Widths, target: float, progress: Progress) -> Widths:
    """A bit given where it lowers the error most, and bits taken elsewhere for it, while that pays."""
    best, point = widths, evaluator.points([widths])[0]
    for _ in range(_EXCHANGES):
        if len(evaluator.known) > _BUDGET:
            return best
        given = [_changed(best, k, 1) for k in range(len(best))]
        errors = [each.error for each in evaluator.points(given)]
        order = sorted(range(len(given)), key=lambda k: (errors[k], k))
        improved = False
        for k in order[:3]:
            other = _descended(evaluator, given[k], target, progress)
            found = evaluator.points([other])[0]
            if found.cost < point.cost:
                best, point, improved = other, found, True
                break
        if not improved:
            return best
    return best


def _changed(widths: Widths, k: int, by: int) -> Widths:
    result = widths.copy()
    result[k] += by
    return result


def _confirmed(
    design: Design,
    found: _Descent,
    checks: list[Judged],
    tolerance: float,
    evaluator: _Evaluator,
) -> tuple[Found | None, Plots, float]:
    """The result where the bit-exact engine agrees; the tracks drawn that are worst; and the error."""
    typed = None
    variables = found.variables
    signals = specification_of(found.base, variables, found.widths)
    while typed is None:
        try:
            typed = numbers(design.model, design.algorithm, signals)
        except InvalidValueError as error:
            if error.key not in signals.signals:
                raise
            # A value that these formats let stay exact has none of its own.
            kept = {name: form for name, form in signals.signals.items() if name != error.key}
            signals = replace(signals, signals=kept)
    specification = signals
    simulations = [simulate(design.model, design.algorithm(design.model), typed, on.plots) for on in checks]
    errors = [float(np.nanmax(on.excess(each.exact.x))) for on, each in zip(checks, simulations, strict=True)]
    worst = checks[0].worst(simulations[0].exact.x, _WORST)
    program, origins = evaluator.engine.program, typed.typed.graph.origins
    steering = {program.slots[k].name for k in program.steering}
    monitors = {slot.name for slot in program.slots} - steering
    # What only innovations and NIS rest on has the design's own formats.
    clamped = any(each.stimulus.clipped for each in simulations) or any(
        count and signal_of(origins[k]).name not in monitors
        for each in simulations
        for k, count in each.trace.violations.items()
    )
    if clamped or not max(errors) <= tolerance:
        return None, worst, max(errors)
    point = evaluator.points([found.widths])[0]
    uniform = np.full(len(variables), found.uniform, np.int64)
    every = evaluator.known.values()
    return (
        Found(
            specification=specification,
            variables=variables,
            widths=found.widths,
            point=point,
            uniform=found.uniform,
            uniform_point=evaluator.points([uniform])[0],
            unseen=errors[0],
            unseen_data=errors[1] if len(errors) > 1 else None,
            front=front_of([*every]),
            candidates=len(evaluator.known),
        ),
        worst,
        max(errors),
    )


def front_of(points: list[Point]) -> tuple[Point, ...]:
    """The points that no other beats in both cost and error, by cost."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p.cost, p.error)):
        if np.isfinite(point.error) and (not front or point.error < front[-1].error):
            front.append(point)
    return tuple(front)


def _cleared(specification: FixedSpecification) -> FixedSpecification:
    """The specification without the formats that are to be chosen."""
    kept = {name: form for name, form in specification.classes.items() if name in ("constant", "nis")}
    return replace(specification, classes=kept, signals={})


def _constant_width(specification: FixedSpecification) -> int:
    form = specification.form("constant")
    return form if isinstance(form, int) else form.width


def _joined(a: Ranges, b: Ranges) -> Ranges:
    return Ranges(
        low=tuple(np.minimum(a.low, b.low).tolist()),
        high=tuple(np.maximum(a.high, b.high).tolist()),
        declared=a.declared & b.declared,
    )
