"""``estimates.csv``: its columns, its rows, and that its numbers read back."""

import csv
import io
from dataclasses import replace

import pytest

from kalmanhdl.report.estimates import estimates_csv


def test_columns_and_rows_are_those_of_the_data(radar):
    model, simulation = radar.hardware.design.model, radar.simulation
    rows = list(csv.DictReader(io.StringIO(estimates_csv(model, simulation))))
    per_state = ("reference", "exact", "reference_var", "exact_var")
    states = [f"{name}_{state}" for state in model.state_names for name in per_state]
    assert list(rows[0]) == ["track", "step", *states, "nis"]
    assert len(rows) == simulation.plots.active.sum()
    places = [(simulation.plots.tracks.index(row["track"]), int(row["step"])) for row in rows]
    assert places == sorted(places)


def test_numbers_read_back_and_cells_without_estimate_are_empty(radar):
    model, simulation = radar.hardware.design.model, radar.simulation
    for row in csv.DictReader(io.StringIO(estimates_csv(model, simulation))):
        step, track = int(row["step"]), simulation.plots.tracks.index(row["track"])
        if not simulation.valid[step, track]:
            assert row["exact_range"] == row["nis"] == ""
            continue
        assert float(row["exact_bearing_rate"]) == simulation.exact.x[step, track, 3]
        assert float(row["reference_var_range"]) == simulation.reference.P[step, track, 0, 0]
        assert float(row["nis"]) == simulation.exact.nis[step, track]


@pytest.mark.parametrize("name", ["a\nb", "a\rb", "a\r\nb", 'a"b', "a,b", " a", "\u00e4"])
def test_a_track_of_any_name_reads_back(radar, name):
    simulation = radar.simulation
    plots = replace(simulation.plots, tracks=(name, *simulation.plots.tracks[1:]))
    text = estimates_csv(radar.hardware.design.model, replace(simulation, plots=plots))
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    assert len(rows) == plots.active.sum()
    assert {row["track"] for row in rows} == set(plots.tracks)
