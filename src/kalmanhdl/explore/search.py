"""Number formats chosen by the tool: the fewest bits, or the least area, within a tolerance.

Every candidate is a run of the format engine (``explore.descent`` says which); what is chosen is confirmed by
the bit-exact engine on tracks that the search has not seen.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from kalmanhdl.algorithm.filter import Filter
from kalmanhdl.design import Design
from kalmanhdl.errors import FormatError
from kalmanhdl.explore.choice import Variable, specification_of
from kalmanhdl.explore.descent import (
    balanced,
    best_uniform,
    descended,
    exchanged,
    fit_constants,
    fit_ranges,
    look_around,
    together,
    widen_ranges,
)
from kalmanhdl.explore.evaluator import MOST_BITS, Evaluator, Objective, Point, Widths
from kalmanhdl.explore.format_engine import FormatEngine
from kalmanhdl.explore.monte_carlo import Tested, tested
from kalmanhdl.explore.program import Program, program_of
from kalmanhdl.explore.tolerance import BAND_TRACKS, BandCase, Case, ErrorCase
from kalmanhdl.explore.tracks import (
    Judged,
    drawn_plots,
    drive_of,
    joined,
    judged,
    split,
    usual_steps,
)
from kalmanhdl.graph.operations import Reciprocal
from kalmanhdl.numerics.integers import Numbers, Reals, in_reals, numbers
from kalmanhdl.numerics.signals import signal_of
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.side_by_side import Simulation, simulate
from kalmanhdl.target import device
from kalmanhdl.validation import InvalidValueError

Progress = Callable[[str], None]

TRACKS = 64
# What is chosen on some tracks is to hold on others: so much of what is allowed is used on those.
_MARGIN = 0.8
_ATTEMPTS = 8
_DESCENTS, _DRAWINGS = 3, 3
# Bits that every signal gets beyond those of the search, which allows errors as much greater as such bits
# make them smaller. What rounding adds is the same then, but where a filter breaks is so many bits away.
_SPARE = 2
# More bits than any lack of accuracy takes.
_MANY = 8
# How often other tracks are drawn where the float reference is outside of a band.
_CHANCES = 4
# Tracks on which a choice failed that join those of the search.
_WORST = 16
_WIDE = 8
# The numbers of their drawings come after this one.
_WIDE_NUMBER = 1000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What a search found.

    ``uniform`` is the least word length that holds if all signals have it; ``point`` and ``uniform_point``
    are as on the tracks of the search. On tracks that the search did not see, by the bit-exact engine:
    ``unseen`` is the greatest excess of a state's error, ``unseen_data`` that on the user's data, and
    ``bands`` are the statistics of float reference and engine where consistency was asked for. ``front`` is
    sorted by cost.
    """

    specification: FixedSpecification
    program: Program
    variables: tuple[Variable, ...]
    widths: Widths
    objective: Objective
    point: Point
    uniform: int
    uniform_point: Point
    unseen: float | None
    unseen_data: float | None
    bands: tuple[Tested, Tested] | None
    front: tuple[Point, ...]
    candidates: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Task:
    """What is searched for, and by which tracks: their numbers come from ``seed``."""

    design: Design
    base: FixedSpecification
    reals: Reals
    program: Program
    filter_: Filter
    tolerance: float | None
    consistency: bool
    steps: int
    tracks: int
    seed: int

    def drawn(self, tracks: int, number: int, *, coast: int | None = None) -> Plots:
        """Tracks drawn from the model, others for every number."""
        coast = self.base.coast if coast is None else coast
        return drawn_plots(self.design.model, coast, self.steps, tracks, self.seed + number)

    def judged(self, plots: Plots) -> Judged:
        """Plots with the float reference's estimates."""
        return judged(self.design.model, self.filter_, plots)

    def error_case(self, plots: Plots) -> ErrorCase:
        """Plots on which errors are compared."""
        on, names = self.judged(plots), [f"x[{i}]" for i in range(self.design.model.n)]
        return ErrorCase(
            engine=FormatEngine.of(self.program, self.base, names),
            drive=drive_of(self.program, self.reals.scaling, on),
            on=on,
            scales=np.array([self.reals.scales[name] for name in names]),
            tolerance=np.inf if self.tolerance is None else self.tolerance,
        )

    def band_case(self) -> Case:
        """Tracks on which NEES and NIS are compared: no plot of them is missed."""
        on = self.judged(self.drawn(self.tracks, 100, coast=0))
        return BandCase.of(self.program, self.base, self.filter_, on, self.reals)


def search(
    design: Design,
    *,
    tolerance: float | None = 0.01,
    consistency: bool = False,
    objective: Objective = Objective.BITS,
    data: Plots | None = None,
    seed: int = 1,
    steps: int | None = None,
    tracks: int = TRACKS,
    workers: int = 2,
    progress: Progress = lambda _: None,
) -> Found:
    """Formats for a design within a relative excess of its root mean square errors, its consistency kept.

    ``tolerance`` None asks nothing of errors; with ``consistency`` NEES and NIS of the bit-exact engine lie
    in their bands of 95 % over tracks that the search did not see. Deterministic for a seed.

    Raises FormatError where no word length up to 56 bits does, and where the float reference itself is not
    consistent; DesignError where the design is not in fixed point or nothing is asked for; ToolError without
    a C compiler.
    """
    if tolerance is None and not consistency:
        raise InvalidValueError("formats", "tolerance", ": give one, or ask for consistency")
    base = _cleared(design.fixed_point)
    progress("tracing the filter and drawing tracks")
    reals = in_reals(design.model, design.algorithm, base)
    task = _Task(
        design=design,
        base=base,
        reals=reals,
        program=program_of(reals.graph, reals.ranges),
        filter_=design.algorithm(design.model),
        tolerance=tolerance,
        consistency=consistency,
        steps=steps or usual_steps(design.model),
        tracks=tracks,
        seed=seed,
    )
    with ThreadPoolExecutor(workers) as pool:
        return _searched(task, objective, data, pool, progress)


def _searched(
    task: _Task, objective: Objective, data: Plots | None, pool: ThreadPoolExecutor, progress: Progress
) -> Found:
    chosen_by, judged_by = (None, None) if data is None else split(data)
    drawn = task.drawn(task.tracks, 0)
    cases = _cases(task, drawn, chosen_by)
    target = task.design.target
    evaluator = Evaluator(
        engine=cases[0].engine,
        base=task.base,
        cases=cases,
        wide=task.error_case(task.drawn(_WIDE * task.tracks, _WIDE_NUMBER)),
        objective=objective,
        part=device(target.device, target.grade),
        monitors=task.consistency,
        pool=pool,
        headroom=dict(task.base.headroom),
    )
    return _Search(
        task=task,
        evaluator=evaluator,
        progress=progress,
        drawn=drawn,
        chosen_by=chosen_by,
        judged_by=judged_by,
    ).found()


@dataclass(slots=True, kw_only=True, eq=False)
class _Search:
    """A search on its way: the tracks that it has seen become more.

    ``share`` is how much of what is allowed candidates may use, ``alone`` what each signal bears by itself,
    ``drawings`` how often many tracks were drawn to find those on which a choice fails.
    """

    task: _Task
    evaluator: Evaluator
    progress: Progress
    drawn: Plots
    chosen_by: Plots | None
    judged_by: Plots | None
    share: float = _MARGIN
    alone: Widths | None = None
    drawings: int = 0

    @property
    def looser(self) -> float:
        """How much greater errors are without the spare bits; NEES and NIS may move by less."""
        return float((2 if self.task.consistency else 4) ** _SPARE)

    def found(self) -> Found:
        """What is chosen, confirmed on tracks not seen."""
        self._heights()
        uniform, widths = self._chosen()
        for attempt in range(_ATTEMPTS):
            self.progress("confirming with the bit-exact engine on tracks that were not seen")
            trial = _tried(self.task, self.evaluator, widths, self.judged_by, attempt)
            if trial.holds:
                return _found(self.task, self.evaluator, widths, uniform + _SPARE, self.share, trial)
            mended = self._mend(widths, trial)
            if mended is None:
                uniform, widths = self._chosen()
            else:
                widths = mended
        raise self._hopeless("tracks not seen")

    def _chosen(self) -> tuple[int, Widths]:
        """The best word length without the spare bits, and widths with them."""
        uniform = self._uniform()
        return uniform, self._spared(self._fewest(uniform, self._balanced(uniform)))

    def _heights(self) -> None:
        """Bits above the binary point, one more where every further drawing of tracks asks for them.

        What still grows with the number of tracks will grow with the tracks to come.
        """
        fit_ranges(self.evaluator)
        grown = sum(self._draw() for _ in range(_DRAWINGS))
        widen_ranges(self.evaluator, {self.evaluator.variables[k].name for k in np.flatnonzero(grown)})

    def _uniform(self) -> int:
        """The best word length, which the widths of signals that are not yet known have as well."""
        self.progress("finding the best uniform word length")
        evaluator = self.evaluator
        fit_constants(evaluator, self.share)
        uniform = int(
            self._held(lambda: evaluator.uniform(best_uniform(evaluator, self.share * self.looser)))[0]
        )
        if uniform != evaluator.base.width:
            evaluator.use(replace(evaluator.base, width=uniform), evaluator.constant_width)
        return uniform

    def _balanced(self, uniform: int) -> Widths:
        """Widths at which all signals use about as much of what is allowed."""
        self.progress(f"{uniform} bits a word; finding what each signal bears")

        def chosen() -> Widths:
            share = self.share * self.looser
            self.alone = balanced(self.evaluator, uniform, share, self.alone)
            return together(self.evaluator, self.alone, uniform, share)

        return self._held(chosen)

    def _fewest(self, uniform: int, widths: Widths) -> Widths:
        """From there downwards, as far as the choice holds on many other tracks."""
        evaluator, share = self.evaluator, self.share * self.looser
        for _ in range(_DESCENTS):
            way = descended(evaluator, widths, share, self.progress)
            way.append(exchanged(evaluator, way[-1], share, self.progress))
            shift = self._draw()
            widths = way[-1] + shift
            found, worst = evaluator.widely(widths, _WORST)
            if found <= self.looser:
                return widths
            self._complain(found)
            shift = shift + self._see(worst)
            way = [each + shift for each in way]
            # Widths at which the errors on the tracks that joined are small enough again.
            widths = way[_furthest(way, lambda each: evaluator.point(each).share <= share)]
        return self._wider(widths, lambda each: evaluator.widely(each, 0)[0] <= self.looser)

    def _spared(self, widths: Widths) -> Widths:
        """Widths of the search with bits that keep them from where the filter breaks: all, or all but one.

        Of what could be taken back, so much is that the errors on many other tracks are as allowed too.
        """
        evaluator = self.evaluator
        spared = widths + self._draw() + _SPARE

        def holds(each: Widths) -> bool:
            return evaluator.point(each).share <= self.share and evaluator.widely(each, 0)[0] <= self.share

        wider = self._wider(spared, holds)
        way = descended(evaluator, wider, self.share, self.progress, spared - 1)
        return way[_furthest(way, holds)]

    def _wider(self, widths: Widths, holds: Callable[[Widths], bool]) -> Widths:
        """As many bits more everywhere as it takes to hold.

        Where even many do not, values that narrower signals made greater lack bits above the binary point.
        """
        for _ in range(_ATTEMPTS):
            for more in range(_MANY):
                if holds(widths + more):
                    return widths + more
            reach = self._reach(widths + _MANY)
            if not reach.any():
                break
            widths = widths + reach
        raise self._hopeless("many tracks")

    def _held(self, choose: Callable[[], Widths]) -> Widths:
        """A choice that holds on many other tracks: those on which it does not join the tracks seen."""
        for _ in range(_ATTEMPTS):
            self._draw()
            widths = choose()
            share, worst = self.evaluator.widely(widths, _WORST)
            if share <= self.looser:
                return widths
            self._complain(share)
            self._see(worst)
        raise self._hopeless("many tracks")

    def _complain(self, share: float) -> None:
        by = f"{share:.0%} of what is allowed" if np.isfinite(share) else "values beyond their formats"
        self.progress(f"{by} on many other tracks: the worst join those seen")

    def _draw(self) -> Widths:
        """Many other tracks than before; the bits that each signal needs more for their ranges."""
        self.drawings += 1
        tracks = self.task.drawn(_WIDE * self.task.tracks, _WIDE_NUMBER + self.drawings)
        self.evaluator.wide = self.task.error_case(tracks)
        return self._reach()

    def _see(self, worst: Plots) -> Widths:
        """Tracks join those on which candidates are run; the bits that each signal needs more for them."""
        self.drawn = joined(self.drawn, worst)
        self.evaluator.judge(_cases(self.task, self.drawn, self.chosen_by))
        return self._reach()

    def _reach(self, widths: Widths | None = None) -> Widths:
        before = self.evaluator.headroom_of
        fit_ranges(self.evaluator, widths)
        more = self.evaluator.headroom_of - before
        if self.alone is not None:
            self.alone = self.alone + more
        return more

    def _mend(self, widths: Widths, trial: "_Trial") -> Widths | None:
        """What mends a choice that lacks bits above the binary point alone; None where it takes another one.

        The tracks on which it failed are seen from now on.
        """
        evaluator = self.evaluator
        seen = self._see(trial.worst)
        # None of the tracks kept may show which values left their formats.
        lacking = np.array([v.name in trial.short for v in evaluator.variables]) & (seen == 0)
        widen_ranges(evaluator, {evaluator.variables[k].name for k in np.flatnonzero(lacking)})
        mended: Widths = widths + seen + lacking
        if evaluator.point(mended).share > 1:
            return None
        if trial.share > 1:
            # By how much it failed, with a margin, within reason.
            self.share *= min(0.85, max(0.9 / trial.share, 0.25))
            return None
        return mended

    def _hopeless(self, where: str) -> FormatError:
        return FormatError(
            f"{self.task.design.name}: formats that hold on {where} were not found: allow more error"
        )


def _furthest(way: list[Widths], holds: Callable[[Widths], bool]) -> int:
    """The last place of a way at which it holds, or the first of all."""
    good, bad = 0, len(way)
    while bad - good > 1:
        middle = (good + bad) // 2
        if holds(way[middle]):
            good = middle
        else:
            bad = middle
    return good


def _cases(task: _Task, drawn: Plots, chosen_by: Plots | None) -> tuple[Case, ...]:
    """What candidates must hold; the tracks drawn come first."""
    cases: list[Case] = [task.error_case(each) for each in (drawn, chosen_by) if each is not None]
    if task.consistency:
        cases.append(task.band_case())
    return tuple(cases)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Trial:
    """What the bit-exact engine makes of a choice: ``share`` of what is allowed, values too short, by name,
    and the tracks on which it is worst."""

    specification: FixedSpecification
    share: float
    unseen: float | None
    unseen_data: float | None
    bands: tuple[Tested, Tested] | None
    short: set[str]
    worst: Plots

    @property
    def holds(self) -> bool:
        return self.share <= 1 and not self.short


def _tried(
    task: _Task, evaluator: Evaluator, widths: Widths, judged_by: Plots | None, attempt: int
) -> _Trial:
    specification, typed = _numbers(
        task.design, specification_of(evaluator.base, evaluator.variables, widths)
    )
    model, chosen = task.design.model, {v.name for v in evaluator.variables}
    checks = [task.judged(task.drawn(2 * task.tracks, 1 if attempt == 0 else 2 + attempt))]
    if judged_by is not None:
        checks.append(task.judged(judged_by))
    simulations = [simulate(model, task.filter_, typed, on.plots, optimised=False) for on in checks]
    short = set[str]().union(*(_short(each, typed, chosen) for each in simulations))
    errors = [float(np.nanmax(on.excess(each.exact.x))) for on, each in zip(checks, simulations, strict=True)]
    share = 0.0 if task.tolerance is None else max(errors) / task.tolerance
    bands = None
    if task.consistency:
        simulation, bands = _consistent(task, typed, attempt)
        short |= _short(simulation, typed, chosen)
        share = max(share, _band_share(bands))
    asked = task.tolerance is not None
    return _Trial(
        specification=specification,
        share=share if np.isfinite(share) else np.inf,
        unseen=errors[0] if asked else None,
        unseen_data=errors[1] if asked and len(errors) > 1 else None,
        bands=bands,
        short=short,
        worst=checks[0].worst(simulations[0].exact.x, _WORST),
    )


def _consistent(task: _Task, typed: Numbers, attempt: int) -> tuple[Simulation, tuple[Tested, Tested]]:
    """NEES and NIS of float reference and engine, on tracks on which the reference's lie in their bands.

    By chance one of twenty lies outside. Raises FormatError where it is more than chance.
    """
    for number in range(_CHANCES):
        plots = task.drawn(BAND_TRACKS, 200 + _CHANCES * attempt + number, coast=0)
        simulation = simulate(task.design.model, task.filter_, typed, plots, optimised=False)
        reference, exact = tested(simulation)
        outside = [
            each for each in (("NEES", reference.nees), ("NIS", reference.nis)) if not each[1].consistent
        ]
        if not outside:
            return simulation, (reference, exact)
    name, found = outside[0]
    raise FormatError(
        f"{task.design.name}: {name} of the float reference itself is {found.mean:.4f}, outside of "
        f"{found.low:.4f} to {found.high:.4f}: mend the model, or ask for a tolerance of errors alone"
    )


def _band_share(bands: tuple[Tested, Tested]) -> float:
    """1 where NEES and NIS of the engine lie in their bands, more the further they lie outside."""
    worst = 0.0
    for own in (bands[1].nees, bands[1].nis):
        half, centre = (own.high - own.low) / 2, (own.high + own.low) / 2
        worst = max(worst, abs(own.mean - centre) / half if own.mean == own.mean else np.inf)
    return worst


def _numbers(design: Design, signals: FixedSpecification) -> tuple[FixedSpecification, Numbers]:
    """The integers of a specification, without what it says of values that its formats let stay exact."""
    while True:
        try:
            return signals, numbers(design.model, design.algorithm, signals)
        except InvalidValueError as error:
            if error.key not in signals.signals:
                raise
            kept = {name: form for name, form in signals.signals.items() if name != error.key}
            signals = replace(signals, signals=kept)


def _short(simulation: Simulation, typed: Numbers, chosen: set[str]) -> set[str]:
    """The names of what left its format where it mattered. What is not chosen has the design's formats."""
    graph, found = typed.typed.graph, set[str]()
    for index, count in simulation.trace.violations.items():
        signal = signal_of(graph.origins[index])
        reciprocal = isinstance(graph.operations[index], Reciprocal)
        name = "reciprocal" if reciprocal else signal.name
        if count:
            found.add(name if name in chosen else signal.signal_class)
    if simulation.stimulus.clipped:
        found |= {name for name in chosen if name.startswith(("z[", "u["))}
    return found & chosen


def _found(
    task: _Task, evaluator: Evaluator, widths: Widths, uniform: int, share: float, trial: _Trial
) -> Found:
    look_around(evaluator, widths)
    while uniform < MOST_BITS and evaluator.point(evaluator.uniform(uniform)).share > share:
        uniform += 1
    return Found(
        specification=trial.specification,
        program=evaluator.program,
        variables=evaluator.variables,
        widths=widths,
        objective=evaluator.objective,
        point=evaluator.point(widths),
        uniform=uniform,
        uniform_point=evaluator.point(evaluator.uniform(uniform)),
        unseen=trial.unseen,
        unseen_data=trial.unseen_data,
        bands=trial.bands,
        front=front_of([*evaluator.known.values()]),
        candidates=evaluator.candidates,
    )


def front_of(points: list[Point]) -> tuple[Point, ...]:
    """The points that no other beats in both cost and share, by cost."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p.cost, p.share)):
        if np.isfinite(point.share) and (not front or point.share < front[-1].share):
            front.append(point)
    return tuple(front)


def _cleared(specification: FixedSpecification) -> FixedSpecification:
    """The specification without the formats that are to be chosen."""
    kept = {name: form for name, form in specification.classes.items() if name in ("constant", "nis")}
    return replace(specification, classes=kept, signals={})
