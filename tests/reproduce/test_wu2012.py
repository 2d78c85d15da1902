"""The experiment of wu2012, and its filter on the track of a UAV."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.algorithm import Converted
from kalmanhdl.design import Design
from kalmanhdl.graph.elements import elements, rows
from kalmanhdl.model.conversion import conversion, measured
from kalmanhdl.reproduce.uav import uav_model, uav_track
from kalmanhdl.reproduce.wu2012 import denoise, figures, paper_model, paper_target, reproduction
from kalmanhdl.simulate.commands import commands, started
from kalmanhdl.simulate.data import read_plots
from kalmanhdl.simulate.reference import reference
from test_design_file import assert_same

DESIGNS = Path(__file__).parents[2] / "designs"


def test_the_design_file_is_the_papers_model():
    design = Design.load(DESIGNS / "wu2012.toml")
    assert_same(design.model, paper_model())
    assert design.algorithm == Converted()


def test_the_target_is_the_papers():
    target = paper_target()
    np.testing.assert_array_equal(target[0], [700, np.pi / 90, np.pi / 90])
    assert target[-1, 1] == pytest.approx(np.pi / 1000)
    assert np.ptp(target[:, 2]) == 0
    np.testing.assert_allclose(np.diff(target[:, 0]), -400 * 0.8192e-3)


def test_three_frames_start_the_filter_and_it_denoises_all_three_axes():
    model, target = paper_model(), paper_target(600)
    paper, better = (denoise(model, target, each) for each in (Converted(), Converted(at="better")))
    for denoised in (paper, better):
        assert np.isnan(denoised.estimates[:2]).all()
        assert np.isfinite(denoised.estimates[2:]).all()
    # Along the line of sight the paper's R, correlated with the noise of its plot, leaves a bias.
    assert (paper.error[1:] < paper.plot_error[1:] / 3).all()
    assert paper.error[0] < paper.plot_error[0] / 1.2
    assert (better.error < better.plot_error / 3).all()


@pytest.mark.slow
def test_single_precision_agrees_with_double():
    found = figures(frames=600)
    assert found.single.unbounded == 0
    # Beside what the plots are uncertain by; not equal, or it would be no single precision.
    assert (found.single.apart < found.paper.plot_error / 20).all()
    assert (found.single.apart > 0).all()
    np.testing.assert_allclose(found.single.error, found.paper.error, rtol=0.02)
    handed = reproduction(found)
    assert {len(row) for row in handed.rows} == {len(handed.columns)}
    assert set(handed.charts) == {"position", "error", "uav"}
    assert found.uav_single.unbounded == 0
    assert (found.uav_single.apart < found.uav.plot_error / 20).all()
    assert (found.uav.error < found.uav.plot_error).all()


@pytest.mark.slow
def test_the_papers_filter_is_biased_along_the_line_of_sight_and_the_better_one_is_not():
    model, target = paper_model(), paper_target()
    paper, better = (
        denoise(model, target, each, tracks=20) for each in (Converted(), Converted(at="better"))
    )
    assert paper.bias[0] > 3 * paper.expected[0]
    assert abs(better.bias[0]) < 0.3 * better.expected[0]
    assert better.error[0] < 1.1 * better.expected[0]


def test_the_uavs_track_is_denoised_in_all_three_axes():
    design = Design.load(DESIGNS / "uav_radar.toml")
    model = design.model
    plots = read_plots(DESIGNS / "data" / "uav_radar.csv", model)
    z, truth = plots.z[:300], plots.truth[:300, :, :3]
    given = commands(model, z, plots.active[:300])
    found = reference(design.algorithm(model), given, z, plots.u[:300])
    there = started(model, given)
    seen = rows(conversion(model.variances).mean(elements(z)), z.shape[:2])
    error, raw = (np.sqrt(((x[..., :3] - truth)[there] ** 2).mean(axis=0)) for x in (found.x, seen))
    assert (error < raw * [0.75, 0.7, 0.4]).all()
    expected = np.sqrt(np.einsum("sii->si", found.P[there])[:, :3].mean(axis=0))
    assert (np.abs(error / expected - 1) < 0.3).all()
    # And with noise that no table holds.
    target = rows(measured(elements(truth[:200, 0])), (200,))
    again = denoise(model, target, design.algorithm, tracks=3, seed=5, settled=20)
    assert (again.error < again.plot_error * [0.75, 0.7, 0.4]).all()


def test_the_uavs_table_is_what_its_script_makes():
    table = DESIGNS / "data" / "uav_radar.csv"
    script = DESIGNS / "data" / "make_uav_radar.py"
    made = subprocess.run([sys.executable, script, "-"], check=True, capture_output=True).stdout
    assert made == table.read_bytes()


def test_the_track_of_the_uav_is_that_of_the_design_file():
    design, track = Design.load(DESIGNS / "uav_radar.toml"), uav_track()
    assert_same(design.model, uav_model())
    plots = read_plots(DESIGNS / "data" / "uav_radar.csv", design.model)
    np.testing.assert_array_equal(plots.z, track.z)
    np.testing.assert_array_equal(plots.truth[:, 0, :3], track.truth)
