"""Accuracy against word length, and consistency over many tracks."""

from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.errors import DesignError
from kalmanhdl.explore.monte_carlo import monte_carlo
from kalmanhdl.explore.sweep import Split, sweep

LEE = Design.load("designs/lee1997.toml")


def test_more_bits_bring_the_error_down_to_the_float_reference():
    rows = sweep(LEE, (7, 12, 16, 24), ("conventional", "joseph"))
    for kind in ("conventional", "joseph"):
        mine = [row for row in rows if row.algorithm == kind]
        assert mine[0].broken
        assert not mine[-1].broken
        assert mine[-1].excess < 1e-3 < mine[0].excess
        assert mine[-1].squared_error == pytest.approx(mine[-1].float_squared_error, rel=1e-2)


def test_a_binary_point_in_the_middle_cannot_hold_large_variances():
    rows = sweep(LEE, (16,), split=Split.HALF, tracks=8)
    assert rows[0].broken == "the start does not fit"


def test_an_unknown_algorithm_is_refused_with_a_hint():
    with pytest.raises(DesignError, match="did you mean 'joseph'"):
        sweep(LEE, (16,), ("josef",))


def test_a_seed_gives_the_same_figures_in_any_number_of_processes():
    one, two = (monte_carlo(LEE, tracks=120, steps=40, seed=3, processes=k) for k in (1, 2))
    assert one.reference.nees == two.reference.nees
    assert one.exact.nis == two.exact.nis
    np.testing.assert_array_equal(one.exact.autocorrelation, two.exact.autocorrelation)
    other = monte_carlo(LEE, tracks=120, steps=40, seed=4)
    assert other.exact.nis != one.exact.nis


def test_a_filter_of_its_own_model_is_consistent_and_one_of_another_is_not():
    model = replace(LEE.model, measurement_range=None)
    honest = monte_carlo(replace(LEE, model=model), tracks=150, steps=40)
    for tested in (honest.reference, honest.exact):
        assert abs(tested.nis.mean / 2 - 1) < 0.05
        assert tested.nees_inside > 0.8
        assert np.all(np.abs(tested.autocorrelation) < 2 * tested.limit)
