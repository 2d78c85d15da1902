"""NEES and NIS of candidates against those of the float reference."""

from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.arithmetic.division import LongDivision
from kalmanhdl.design import Design
from kalmanhdl.explore.program import program_of
from kalmanhdl.explore.tolerance import BandCase, Verdict
from kalmanhdl.explore.tracks import drawn_plots, judged
from kalmanhdl.numerics.integers import in_reals

LEE = Design.load("designs/lee1997.toml")


@pytest.fixture(scope="module")
def case():
    reals = in_reals(LEE.model, LEE.algorithm, LEE.numerics)
    program = program_of(reals.graph, reals.ranges)
    on = judged(LEE.model, LEE.algorithm(LEE.model), drawn_plots(LEE.model, 0, 100, 48, 5))
    exact = replace(LEE.numerics, division=LongDivision())
    return BandCase.of(program, exact, LEE.algorithm(LEE.model), on, reals)


def verdict(case, width, nis=30):
    wide = replace(LEE.numerics, width=width, classes={"nis": nis})
    return case.verdict(case.engine.run(case.engine.forms(wide), 40, case.drive))


def test_wide_words_leave_nees_and_nis_where_they_are(case):
    assert verdict(case, 40).shift < 0.02


def test_narrow_words_move_them(case):
    shifts = [verdict(case, width).shift for width in (9, 14, 40)]
    assert shifts[0] > 4 * shifts[1] > 4 * shifts[2]


def test_the_worse_of_two_verdicts_keeps_what_only_one_asks():
    a = Verdict(share=0.2, error=0.1, shift=np.nan)
    b = Verdict(share=0.4, error=np.nan, shift=0.3)
    assert a.worse(b) == Verdict(share=0.4, error=0.1, shift=0.3)
