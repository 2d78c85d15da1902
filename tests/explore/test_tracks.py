"""How much worse than the float reference an estimate is, whatever the age of the track."""

from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.explore.tracks import drawn_plots, judged
from kalmanhdl.numerics import ranges

LEE = Design.load("designs/lee1997.toml")
FILTER = LEE.algorithm(LEE.model)


@pytest.fixture(scope="module")
def on():
    return judged(LEE.model, FILTER, drawn_plots(LEE.model, 5, 100, 24, 3))


def test_the_reference_itself_adds_nothing(on):
    assert (on.excess(on.estimates.x) == 0.0).all()


def test_what_is_added_is_measured_in_the_reference_s_own_error():
    plots = drawn_plots(LEE.model, 5, 100, 24, 3)
    on = judged(LEE.model, FILTER, replace(plots, truth=None))
    d, signs = 0.3, np.random.default_rng(1).choice([-1.0, 1.0], on.reference.shape)
    x = on.reference + d * on.octave_spread[on.octave] * signs
    assert on.excess(x) == pytest.approx(np.hypot(1.0, d) - 1.0)


def test_an_error_of_settled_tracks_is_not_hidden_by_that_of_their_start(on):
    late = on.octave == on.octave.max()
    small = on.octave_spread[-1]
    x = on.reference + np.where(late[..., None], small, 0.0)
    assert np.all(on.excess(x) >= np.sqrt(2) - 1.0 - 1e-9)


def test_octaves_count_the_estimates_of_a_track(on):
    ages = np.cumsum(on.valid, axis=0)
    seen = on.valid
    np.testing.assert_array_equal(on.octave[seen], np.floor(np.log2(ages[seen])))


def test_plots_are_missed_from_the_start_on_as_often_as_may_be():
    coast, first = 3, LEE.model.initial.points
    plots = drawn_plots(LEE.model, coast, 40, 32, 4)
    missed = np.isnan(plots.z).all(axis=2)
    assert missed[first : first + coast].all(axis=0).any()
    runs = np.lib.stride_tricks.sliding_window_view(missed, coast + 1, axis=0)
    assert not runs.all(axis=-1).any()
    assert not np.isnan(drawn_plots(LEE.model, 0, 40, 32, 4).z).any()


def test_every_second_track_grows_old_where_starts_from_plots_leave_the_ranges_at_once():
    model = Design.load("designs/wu2012.toml").model
    active = drawn_plots(model, 5, 60, 32, 1).active
    lively = ranges.drawn(model, np.random.default_rng(1), 60, 32).relevant
    np.testing.assert_array_equal(active[:, ::2], lively[:, ::2])
    assert lively[-1].sum() == 0
    assert active[-1, 1::2].mean() > 0.7


def test_a_start_whose_rates_the_model_gives_is_drawn_as_it_is():
    model = Design.load("designs/ekf_radar.toml").model
    assert (ranges.unhurried(model, 60) == 1.0).all()
