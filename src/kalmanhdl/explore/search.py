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
    widen_ranges,
    widened,
)
from kalmanhdl.explore.evaluator import Evaluator, Objective, Point, Widths
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
# Tracks on which a choice failed that join those of the search.
_WORST = 16
_WIDE = 16


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

    def error_case(self, plots: Plots) -> Case:
        """Plots on which errors are compared."""
        on, names = self.judged(plots), [f"x[{i}]" for i in range(self.design.model.n)]
        assert self.tolerance is not None
        return ErrorCase(
            engine=FormatEngine.of(self.program, self.base, names),
            drive=drive_of(self.program, self.reals.scaling, on),
            on=on,
            scales=np.array([self.reals.scales[name] for name in names]),
            tolerance=self.tolerance,
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
        wide=drive_of(task.program, task.reals.scaling, task.judged(task.drawn(_WIDE * task.tracks, 2))),
        objective=objective,
        part=device(target.device, target.grade),
        monitors=task.consistency,
        pool=pool,
        headroom=dict(task.base.headroom),
    )
    share = _MARGIN
    fit_ranges(evaluator)
    progress("finding the best uniform word length")
    uniform = best_uniform(evaluator, share)
    evaluator.use(replace(evaluator.base, width=uniform), evaluator.constant_width)
    progress(f"{uniform} bits a word; finding what each signal bears")
    widths = balanced(evaluator, uniform, share)
    widths = descended(evaluator, widths, share, progress)
    widths = exchanged(evaluator, widths, share, progress)
    for attempt in range(_ATTEMPTS):
        progress("confirming with the bit-exact engine on tracks that were not seen")
        trial = _tried(task, evaluator, widths, judged_by, attempt)
        if trial.holds:
            return _found(task, evaluator, widths, uniform, share, trial)
        # The tracks on which it failed are seen from now on, and others take their place.
        drawn = joined(drawn, trial.worst)
        evaluator.judge(_cases(task, drawn, chosen_by))
        fit_ranges(evaluator)
        if trial.short and evaluator.point(widths).share <= 1:
            # None of the tracks kept shows what left its format.
            widen_ranges(evaluator, trial.short)
        if trial.share > 1 and not trial.short:
            # By how much it failed, with a margin, within reason.
            share *= min(0.85, max(0.9 / trial.share, 0.25))
        fit_constants(evaluator, share)
        widths = widened(evaluator, widths + 1, share)
        widths = descended(evaluator, widths, share, progress)
    raise FormatError(
        f"{task.design.name}: formats that hold on tracks not seen were not found: allow more error"
    )


def _cases(task: _Task, drawn: Plots, chosen_by: Plots | None) -> tuple[Case, ...]:
    """What candidates must hold; the tracks drawn come first."""
    cases: list[Case] = []
    if task.tolerance is not None:
        cases += [task.error_case(each) for each in (drawn, chosen_by) if each is not None]
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
        plots = task.drawn(BAND_TRACKS, 200 + attempt, coast=0)
        simulation = simulate(model, task.filter_, typed, plots, optimised=False)
        short |= _short(simulation, typed, chosen)
        bands = tested(simulation)
        share = max(share, _band_share(task.design, bands))
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


def _band_share(design: Design, bands: tuple[Tested, Tested]) -> float:
    """1 where NEES and NIS of the engine lie in their bands, more the further they lie outside."""
    reference, exact = bands
    worst = 0.0
    for name, float_, own in (("NEES", reference.nees, exact.nees), ("NIS", reference.nis, exact.nis)):
        if not float_.consistent:
            raise FormatError(
                f"{design.name}: {name} of the float reference itself is {float_.mean:.4f}, outside of "
                f"{float_.low:.4f} to {float_.high:.4f}: mend the model, try other tracks by seed, or ask "
                "for a tolerance of errors alone"
            )
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
    while evaluator.point(evaluator.uniform(uniform)).share > share:
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
