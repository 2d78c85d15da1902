"""Accuracy against word length, for one algorithm or several, and where each breaks."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm import ALGORITHMS, Algorithm
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.design import Design
from kalmanhdl.explore.format_engine import FormatEngine, Run, known_clamped
from kalmanhdl.explore.program import Program, program_of
from kalmanhdl.explore.tracks import Judged, drawn_plots, drive_of, judged, usual_steps
from kalmanhdl.numerics.choices import Form
from kalmanhdl.numerics.integers import in_reals
from kalmanhdl.numerics.specification import SIGNAL_CLASSES, FixedSpecification
from kalmanhdl.simulate.data import Plots
from kalmanhdl.simulate.metrics import rmse
from kalmanhdl.validation import InvalidValueError, nearest, shown

Progress = Callable[[str], None]

TRACKS = 64


class Split(Enum):
    """Where the binary point stands: by the range of each signal, or in the middle of every word.

    ``HALF`` is the arrangement of liu2007: half of the bits for sign and integer, half for the fraction,
    one word length throughout, in the model's own units.
    """

    RANGE = "range"
    HALF = "half"


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One algorithm at one word length.

    ``squared_error`` is the mean over states and steps of (true - estimated)^2, the figure of liu2007;
    ``excess`` the greatest excess of a state's root mean square error over the float reference's.
    ``broken`` says why the word length does not do, and is empty where it does.
    """

    algorithm: str
    width: int
    squared_error: float
    float_squared_error: float
    excess: float
    clamped: int
    broken: str


def sweep(
    design: Design,
    widths: Iterable[int],
    algorithms: Iterable[str] = (),
    *,
    split: Split = Split.RANGE,
    bound: float = 1.0,
    data: Plots | None = None,
    seed: int = 1,
    steps: int | None = None,
    tracks: int = TRACKS,
    progress: Progress = lambda _: None,
) -> tuple[Row, ...]:
    """Rows by algorithm and word length, on tracks drawn from the model or on data.

    Without ``algorithms`` it is the design's own. A word length is broken where a value that matters left
    its format, or where the error exceeds the float reference's by more than ``bound`` of it. Values are
    doubles: words beyond 26 bits are computed to within rare last bits.

    Raises DesignError for an unknown or unsuited algorithm, ToolError without a C compiler.
    """
    found: list[Row] = []
    asked = tuple(widths)
    base = design.fixed_point
    steps = steps or usual_steps(design.model)
    plots = data or drawn_plots(design.model, base.coast, steps, tracks, seed)
    for algorithm in _algorithms(design, algorithms):
        progress(f"{algorithm.kind}: {len(asked)} word lengths")
        on = judged(design.model, algorithm(design.model), plots)
        shaped = [_specification(base, width, split, design.model.n) for width in asked]
        reals = in_reals(design.model, algorithm, shaped[0])
        program = program_of(reals.graph, reals.ranges)
        names = [f"x[{i}]" for i in range(design.model.n)]
        scales = np.array([reals.scales[name] for name in names])
        drive = drive_of(program, reals.scaling, on)
        for width, specification in zip(asked, shaped, strict=True):
            engine = FormatEngine.of(program, specification, names)
            form = specification.form("constant")
            run = engine.run(
                engine.forms(specification), form if isinstance(form, int) else form.width, drive
            )
            x = np.moveaxis(run.outputs, 0, -1) * scales
            found.append(_row(algorithm, width, on, x, program, run, bound))
    return tuple(found)


def _row(
    algorithm: Algorithm,
    width: int,
    on: Judged,
    x: NDArray[np.float64],
    program: Program,
    run: Run,
    bound: float,
) -> Row:
    excess = float(np.nanmax(on.excess(x)))
    start, clamped = known_clamped(run, program), int(run.clamped.sum())
    if start:
        broken = "the start does not fit"
    elif clamped:
        broken = f"overflow, {clamped} times"
    elif not excess <= bound:
        broken = "error beyond the bound"
    else:
        broken = ""
    truth = on.plots.truth if on.plots.truth is not None else on.reference
    seen = np.where(on.valid[..., None], x, np.nan)
    squared, exact = (float(np.nanmean(rmse(each, truth) ** 2)) for each in (seen, on.reference))
    return Row(
        algorithm=algorithm.kind,
        width=width,
        squared_error=squared,
        float_squared_error=exact,
        excess=excess,
        clamped=clamped,
        broken=broken,
    )


def _algorithms(design: Design, kinds: Iterable[str]) -> list[Algorithm]:
    found: list[Algorithm] = []
    for kind in kinds:
        if kind not in ALGORITHMS:
            hint = nearest(kind, ALGORITHMS)
            raise InvalidValueError("algorithm", "kind", f" = {shown(kind)} is unknown: {hint}")
        found.append(design.algorithm if kind == design.algorithm.kind else ALGORITHMS[kind]())
    for algorithm in found:
        # Says so where the algorithm does not suit the model.
        algorithm(design.model)
    return found or [design.algorithm]


def _specification(base: FixedSpecification, width: int, split: Split, n: int) -> FixedSpecification:
    if split is Split.HALF:
        half: Form = Fixed(width=width, fraction=width // 2)
        classes = dict.fromkeys(SIGNAL_CLASSES, half)
        return replace(base, width=width, classes=classes, signals={}, scale=(1.0,) * n, covariance_scale=1.0)
    kept = {name: form for name, form in base.classes.items() if name in ("constant", "nis")}
    return replace(base, width=width, classes=kept, signals={})


def as_records(rows: tuple[Row, ...]) -> list[dict[str, str | int | float]]:
    """Rows as plain records, for CSV and JSON."""
    return [asdict(row) for row in rows]
