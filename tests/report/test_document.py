"""The JSON report: its keys, its figures against other ways to them, and that it is the same every time."""

import csv
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builds import DESIGNS, hardware

from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import proof_of
from kalmanhdl.report.document import document, plain
from kalmanhdl.report.page import page
from kalmanhdl.report.record import Record
from kalmanhdl.report.writer import json_text

# The stable keys, as DESIGN.md lists them.
STABLE = {
    "": {"design", "schema", "model", "algorithm", "operations", "schedule", "accuracy", "verification",
         "implementation", "seconds"},
    "model": {"states", "measurements", "components"},
    "operations": {"add", "subtract", "multiply", "constant_multiply", "divide", "reciprocal", "square_root"},
    "schedule": {"interval_cycles", "latency_cycles", "channels", "units", "recurrence_bound_cycles"},
    "accuracy": {"steps", "rmse_reference", "rmse_bitexact", "nis_mean", "saturations"},
    "implementation": {"device", "tool", "fmax_mhz", "luts", "ffs", "multipliers", "block_rams",
                       "latency_ns", "updates_per_second"},
    "seconds": {"trace", "schedule", "verify", "synthesise", "place_and_route"},
}  # fmt: skip


@pytest.fixture(scope="session")
def found(radar: Record) -> dict:
    return document(radar)


@pytest.mark.parametrize("which", ["radar", "lee", "nile"])
def test_every_stable_key_is_there_whatever_stages_ran(which, request):
    found = document(request.getfixturevalue(which))
    for table, keys in STABLE.items():
        assert keys <= set(found[table] if table else found), table
    for run in found["verification"]:
        assert {"simulator", "steps", "mismatches", "cycles_per_second"} <= set(run)


def test_the_text_is_json_and_says_the_same(found):
    assert json.loads(json_text(found)) == found


def test_every_width_says_what_it_rests_on_and_whether_it_always_holds(found):
    rows = found["numerics"]["formats"]
    assert {row["range_by"] for row in rows} <= {
        "the design", "its operands", "declared range", "simulated tracks",
    }  # fmt: skip
    assert {row["overflow"] for row in rows} == {"never", "flagged", "clamped"}
    assert found["numerics"]["proofs"] is None


def test_proofs_are_summed_up_and_stand_in_every_row(nile):
    design = replace(nile.hardware.design, numerics=FixedSpecification(width=8, coast=1))
    made = hardware(design)
    whole = document(record := Record(hardware=made, proof=proof_of(made.design, made.numbers)))
    assert "are proven not to leave their formats" in page(record, whole)
    said = whole["numerics"]
    counted = said["proofs"]["proven"] + said["proofs"]["reachable"] + said["proofs"]["flagged"]
    assert counted == len(made.numbers.typed.violations)
    assert said["proofs"]["contract"]["misses_in_a_row"] == 1
    assert said["proofs"]["parts"][0]["covariances"] > 1
    rows = said["formats"]
    assert {row["overflow"] for row in rows} & {"proven", "reachable", "flagged"}
    assert all(row["least"] <= row["greatest"] for row in rows)
    assert all(row["proof"] for row in rows if row["overflow"] == "proven")


def test_what_is_not_finite_is_null():
    values = {"a": [float("nan"), np.float64("inf")], "b": np.array([1, 2])}
    assert plain(values) == {"a": [None, None], "b": [1, 2]}


def test_the_filter_of_lee1997_needs_eight_multiplications_and_two_reciprocals(lee):
    found = document(lee)
    assert found["operations"]["multiply"] <= 8
    assert found["operations"]["reciprocal"] + found["operations"]["divide"] <= 2
    assert found["operations_monitoring"]["multiply"] > 0
    assert found["model"]["components"] == 2
    assert found["model"]["component_states"] == [["range", "range_rate"], ["bearing", "bearing_rate"]]


def test_latency_and_rate_follow_from_the_best_placement(found):
    placed, schedule = found["implementation"], found["schedule"]
    assert (placed["fmax_mhz"], placed["seed"], placed["luts"]) == (160.0, 2, 1002)
    assert placed["latency_ns"] == pytest.approx(schedule["latency_cycles"] / 0.16)
    assert placed["updates_per_second"] == pytest.approx(160e6 / schedule["interval_cycles"])
    assert [one["seed"] for one in placed["placements"]] == [1, 2]


def test_errors_are_those_of_a_loop_over_the_table(radar, found):
    simulation, squares = radar.simulation, np.zeros((2, 4))
    truth, counted = simulation.plots.truth, 0
    for step, track in zip(*np.nonzero(simulation.valid), strict=True):
        if np.isnan(truth[step, track]).any():
            continue
        for row, estimates in enumerate((simulation.reference, simulation.exact)):
            squares[row] += (estimates.x[step, track] - truth[step, track]) ** 2
        counted += 1
    assert found["accuracy"]["rmse_reference"] == pytest.approx(np.sqrt(squares[0] / counted))
    assert found["accuracy"]["rmse_bitexact"] == pytest.approx(np.sqrt(squares[1] / counted))


def test_two_point_differencing_is_that_of_a_loop_over_the_file(radar, found):
    with (DESIGNS / "data" / "autoferry_radar_target.csv").open() as file:
        rows = list(csv.DictReader(file))
    seen: dict[str, int] = {}
    errors = []
    for old, new in zip([None, *rows], rows, strict=False):
        seen[new["track"]] = seen.get(new["track"], -1) + 1
        step, track = seen[new["track"]], radar.simulation.plots.tracks.index(new["track"])
        if step and old["range_plot"] and new["range_plot"] and radar.simulation.valid[step, track]:
            rate = (float(new["range_plot"]) - float(old["range_plot"])) / (
                float(new["time"]) - float(old["time"])
            )
            errors.append(rate - float(new["truth_range_rate"]))
    one = found["accuracy"]["differencing"][0]
    assert (one["state"], one["samples"]) == ("range_rate", len(errors))
    assert one["rmse"] == pytest.approx(np.sqrt(np.mean(np.square(errors))))
    assert one["rmse_bitexact"] < one["rmse"]


def test_without_truth_the_errors_against_it_are_null(nile):
    accuracy = document(nile)["accuracy"]
    assert accuracy["rmse_reference"] == accuracy["rmse_bitexact"] == [None]
    assert accuracy["rmse_bitexact_to_reference"][0] >= 0
    assert accuracy["differencing"] == []


def test_only_designs_named_after_a_paper_stand_beside_one(lee, found):
    assert found["paper"] is None
    beside = {row["measure"]: row for row in document(lee)["paper"]["figures"]}
    assert beside["operations.multiply"]["paper"] == 12
    assert beside["operations.multiply"]["here"] == document(lee)["operations"]["multiply"]
    assert beside["implementation.updates_per_second"]["here"] is None


_PROGRAM = """
import sys
from builds import record_of
from kalmanhdl.report.document import document
from kalmanhdl.report.page import page
from kalmanhdl.report.writer import json_text
sys.stdout.write(json_text(document(record_of("autoferry_radar", "autoferry_radar_target.csv"))))
nile = record_of("nile", "nile.csv")
sys.stdout.write(page(nile, document(nile)))
"""


def test_report_and_page_do_not_depend_on_the_hash_seed():
    here = str(Path(__file__).parent)
    texts = {
        subprocess.run(
            [sys.executable, "-c", _PROGRAM],
            env=os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": here},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(texts) == 1
    assert "</html>" in texts.pop()
