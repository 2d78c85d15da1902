"""What plots show by themselves, of every kind of model."""

from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.pipeline import simulate
from kalmanhdl.report.accuracy import differencing, nis_inside, updated
from kalmanhdl.report.plots import constant_transition, plot_states
from kalmanhdl.simulate.data import read_plots
from kalmanhdl.tables import accuracy_table

DESIGNS = Path(__file__).parents[2] / "designs"


def radar(name, table):
    design = Design.load(DESIGNS / f"{name}.toml")
    return design.model, read_plots(DESIGNS / "data" / f"autoferry_radar_{table}.csv", design.model), design


@pytest.mark.parametrize("name", ["dcmkf_radar", "ekf_radar"])
def test_a_plot_in_range_and_bearing_shows_a_position(name):
    model, plots, _ = radar(name, "plane")
    shown = plot_states(model, plots)
    r, bearing = plots.z[..., 0], plots.z[..., 1]
    # The debiased conversion of dcmkf_radar is shorter by less than sigma_bearing^2.
    for state, position in ((0, r * np.cos(bearing)), (2, r * np.sin(bearing))):
        assert shown[..., state] == pytest.approx(position, rel=1e-3, nan_ok=True)
    assert np.isnan(shown[..., [1, 3]]).all()
    T = 1.68
    assert constant_transition(model) == pytest.approx(np.kron(np.eye(2), [[1, T], [0, 1]]))


@pytest.mark.parametrize(
    ("name", "table"), [("dcmkf_radar", "plane"), ("ekf_radar", "plane"), ("imm_radar", "target")]
)
def test_filters_of_every_kind_stand_beside_differencing(name, table):
    model, plots, design = radar(name, table)
    simulation = simulate(design, plots)
    found = differencing(model, simulation)
    assert [one.state for one in found] == [1, 3]
    for one in found:
        assert one.samples == 566
        assert one.rmse_bitexact < 0.6 * one.rmse
        assert one.rmse_bitexact == pytest.approx(one.rmse_reference, rel=0.01)
    used = updated(simulation, model.initial.before_update)
    assert 0.9 < nis_inside(simulation.exact.nis, used) < 1
    assert "below its band of 95 %" in accuracy_table(model, simulation)
