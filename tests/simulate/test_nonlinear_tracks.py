"""A nonlinear model down the line: tracks drawn from it, and the engine beside the float reference."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.model.initial import given
from kalmanhdl.model.nonlinear import nonlinear_model
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.pipeline import simulate
from kalmanhdl.report.accuracy import against_truth
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.data import read_plots
from kalmanhdl.simulate.reference import reference
from kalmanhdl.simulate.side_by_side import stimulus_of

DESIGNS = Path(__file__).parents[2] / "designs"


@pytest.fixture(scope="module")
def radar():
    return Design.load(DESIGNS / "ekf_radar.toml")


@pytest.fixture(scope="module")
def boats(radar):
    return read_plots(DESIGNS / "data/autoferry_radar_plane.csv", radar.model)


@pytest.fixture(scope="module")
def simulation(radar, boats):
    return simulate(radar, boats)


def test_drawn_plots_begin_within_their_ranges_and_bearings_stay_within_a_turn(radar):
    plots = simulated(radar.model, coast=5)
    low, high = radar.model.measurement_range.T
    assert (np.abs(plots.z[..., 1]) <= np.pi).all()
    # The first plot has an error of its own.
    assert (plots.z[0, :, 0] >= low[0] - 10).all()
    assert (plots.z[0, :, 0] <= high[0] + 10).all()
    assert plots.relevant.mean() > 0.5


def test_on_tracks_of_its_own_model_the_filter_is_consistent(radar):
    plots = simulated(radar.model, coast=0, tracks=400, seed=3)
    z = np.where(plots.valid, plots.z, np.nan)
    given_commands = commands(radar.model, z, np.ones(z.shape[:2], bool))
    found = reference(radar.algorithm(radar.model), given_commands, z, plots.u)
    # Far away, where a bearing's error is small beside the bend of a circle.
    counted = plots.relevant & (plots.z[..., 0] > 100) & (np.arange(len(z)) > 0)[:, None]
    assert found.nis[counted].mean() == pytest.approx(2.0, abs=0.1)


def test_the_engine_follows_the_reference_on_real_plots(simulation):
    distance = np.nanmax(np.abs(simulation.exact.x - simulation.reference.x), axis=(0, 1))
    np.testing.assert_array_less(distance, [0.05, 0.02, 0.05, 0.02])
    assert np.nanmean(simulation.exact.nis) == pytest.approx(np.nanmean(simulation.reference.nis), rel=0.02)


def test_rates_are_better_than_a_plot_can_say(simulation):
    rmse = against_truth(simulation, simulation.exact.x)
    assert (rmse[[1, 3]] < 0.6).all()


def test_a_bearing_counted_on_past_a_turn_is_the_same_to_hardware_and_reference(radar, boats, simulation):
    turned = replace(boats, z=boats.z + np.array([0.0, 2 * np.pi]))
    typed = numbers(radar.model, radar.algorithm, radar.numerics).typed
    a, b = (stimulus_of(radar.model, typed, each) for each in (boats, turned))
    assert np.abs(a.inputs["z[1]"] - b.inputs["z[1]"]).max() <= 1
    filter_ = radar.algorithm(radar.model)
    found = reference(filter_, b.commands, turned.z, turned.u)
    np.testing.assert_allclose(found.x[simulation.valid], simulation.reference.x[simulation.valid], rtol=1e-9)


def test_noise_by_a_gain_moves_tracks_as_it_says():
    model = nonlinear_model(
        ["p + 0.1*v*cos(a)", "v", "a + 0.1*w"],
        ["p"],
        [[0.04]],
        [[1.0]],
        G=[["0.5*cos(a)"], [1], [0]],
        initial=given([0.0, 1.0, 0.3], np.diag([0.0, 0.0, 0.1])),
        state_names=["p", "v", "a"],
        measurement_names=["p_plot"],
        control_names=["w"],
    )
    random = np.random.default_rng(0)
    x = model.first_states(random, 20_000)
    u, noise = np.full((2, len(x), 1), 0.7), random.standard_normal((2, len(x), 1))
    truth = model.trajectories(x, u, noise, random)
    drift = 0.2 * noise[1, :, 0]
    cosine = np.cos(x[:, 2])
    np.testing.assert_allclose(
        truth[1, :, 0], x[:, 0] + 0.1 * x[:, 1] * cosine + 0.5 * cosine * drift, rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(truth[1, :, 1], x[:, 1] + drift, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(truth[1, :, 2], x[:, 2] + 0.07, rtol=1e-12, atol=1e-12)
    assert x.var(axis=0)[2] == pytest.approx(0.1, rel=0.05)
