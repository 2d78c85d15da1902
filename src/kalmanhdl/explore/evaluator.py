"""Candidates of formats, run and judged: their cost, and how much of what is allowed they use."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.explore.area import estimated_luts
from kalmanhdl.explore.choice import Variable, bits_of, place_forms, variables_of
from kalmanhdl.explore.format_engine import FormatEngine, Run
from kalmanhdl.explore.program import Code, Program
from kalmanhdl.explore.tolerance import NOTHING, Case, ErrorCase, Verdict
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.simulate.data import Plots
from kalmanhdl.target.device import Device

Widths = NDArray[np.int64]

# Doubles hold no more; a double's own rounding takes the place of the last bits.
MOST_BITS = 56
# A sine or a root costs as much time as so many sums.
_FUNCTION = 30


class Objective(Enum):
    """What is to be small: the sum of all widths, or LUTs and multiplier blocks, as they are estimated."""

    BITS = "bits"
    AREA = "area"


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A choice of formats: its bits, its cost (bits or LUTs), and how much of what is allowed it uses.

    ``error`` is the greatest relative excess of a state's error, ``shift`` how far NEES or NIS moved, in half
    bands; NaN where it was not asked for. A ``share`` of 1 is all that is allowed.
    """

    bits: int
    cost: float
    share: float
    error: float
    shift: float


@dataclass(slots=True)
class Evaluator:
    """Points of widths, each found once; every candidate that was ever run is in ``known``.

    ``wide`` are many more tracks, on which few candidates are run. ``headroom`` has bits above those that
    ranges ask for, by the names of variables.
    """

    engine: FormatEngine
    base: FixedSpecification
    cases: tuple[Case, ...]
    wide: ErrorCase
    objective: Objective
    part: Device
    monitors: bool
    pool: ThreadPoolExecutor
    headroom: dict[str, int]
    variables: tuple[Variable, ...] = ()
    known: dict[bytes, Point] = field(default_factory=dict)
    candidates: int = 0
    forms: NDArray[np.void] = field(init=False)

    def __post_init__(self) -> None:
        self.forms = self.engine.forms(self.base)
        self.place()

    @property
    def program(self) -> Program:
        """The filter whose formats are chosen."""
        return self.engine.program

    @property
    def constant_width(self) -> int:
        """Of the model's constants."""
        form = self.base.form("constant")
        return form if isinstance(form, int) else form.width

    @property
    def headroom_of(self) -> Widths:
        """The headroom of each variable."""
        return np.array([self.headroom.get(each.name, 0) for each in self.variables], np.int64)

    @property
    def work(self) -> int:
        """What one candidate costs, in operations."""
        each = sum(_FUNCTION if step.code is Code.FUNCTION else 1 for step in self.program.steps)
        return each * sum(int(np.count_nonzero(case.drive.commands)) for case in self.cases)

    def use(self, base: FixedSpecification, constant: int) -> None:
        """Other formats for what is not chosen; what was known no longer holds."""
        self.base = replace(base, classes=base.classes | {"constant": constant})
        self.forms = self.engine.forms(self.base)
        self.known.clear()

    def judge(self, cases: tuple[Case, ...]) -> None:
        """Other tracks; what was known no longer holds."""
        self.cases = cases
        self.known.clear()

    def place(self) -> None:
        """Binary points anew, after ``headroom`` has changed; what was known no longer holds."""
        self.variables = variables_of(self.program, self.headroom, monitors=self.monitors)
        self.known.clear()

    def uniform(self, width: int) -> Widths:
        """The same width for all."""
        return np.full(len(self.variables), width, np.int64)

    def points(self, many: list[Widths]) -> list[Point]:
        """The points of candidates, in parallel."""
        new = {w.tobytes(): w for w in many if w.tobytes() not in self.known}
        for key, point in zip(new, self.pool.map(self._point, new.values()), strict=True):
            self.known[key] = point
        self.candidates += len(new)
        return [self.known[w.tobytes()] for w in many]

    def point(self, widths: Widths) -> Point:
        """The point of one candidate."""
        return self.points([widths])[0]

    def widely(self, widths: Widths, count: int) -> tuple[float, Plots]:
        """What a candidate uses of what is allowed on the wide tracks, and the ``count`` worst of these.

        A variance that rounding makes negative, which is held at zero, counts by the error that this makes.
        """
        run = self.wide.engine.run(self.placed(widths), self.constant_width, self.wide.drive)
        share = np.inf if run.beyond.any() else self.wide.verdict(run).share
        return share, self.wide.worst(run, count)

    def placed(self, widths: Widths) -> NDArray[np.void]:
        """The formats of the program's slots under widths."""
        return place_forms(self.forms, self.program, self.variables, widths)

    def _point(self, widths: Widths) -> Point:
        forms, verdict = self.placed(widths), NOTHING
        bits = bits_of(self.variables, widths)
        cost = float(bits)
        for number, case in enumerate(self.cases):
            run = case.engine.run(forms, self.constant_width, case.drive)
            if number == 0 and self.objective is Objective.AREA:
                cost = estimated_luts(case.engine, run, self.part, self.base.functions)
            verdict = verdict.worse(_verdict(case, run))
            if not np.isfinite(verdict.share):
                break
        return Point(bits=bits, cost=cost, share=verdict.share, error=verdict.error, shift=verdict.shift)


def _verdict(case: Case, run: Run) -> Verdict:
    if run.clamped.any():
        return Verdict(share=np.inf, error=np.inf, shift=np.inf)
    return case.verdict(run)
