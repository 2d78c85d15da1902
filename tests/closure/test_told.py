"""What a user is told of the rounds: in report, page and printed table, and of wrong options."""

from dataclasses import replace
from pathlib import Path

import pytest
from placer import Placer
from typer.testing import CliRunner

from kalmanhdl.cli import app
from kalmanhdl.closure.rounds import close
from kalmanhdl.design import Design
from kalmanhdl.pipeline import numbers_of, planned, realised
from kalmanhdl.report.document import document
from kalmanhdl.report.page import page
from kalmanhdl.report.record import Record
from kalmanhdl.tables import build_table, closure_table

DESIGNS = Path(__file__).parents[2] / "designs"


@pytest.fixture(scope="module")
def record():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("kalmanhdl.pipeline.verilog_of", lambda design, plan: "")
        design = Design.load(DESIGNS / "lee1997.toml")
        asked = replace(design.architecture, clock_mhz=120.0, channels=64)
        design = replace(design, architecture=asked, target=replace(design.target, rounds=4))
        typed = numbers_of(design)
        closed = close(realised(design, typed, planned(design, typed)), place=Placer({"quantise": 1.9}))
    return Record(hardware=closed.hardware, implemented=closed.implemented, closure=closed.closure)


def test_the_report_has_every_round(record):
    told = document(record)["implementation"]
    first, *_, last = told["closure"]["rounds"]
    assert told["asked_mhz"] == told["closure"]["asked_mhz"] == 120.0
    assert told["fmax_mhz"] == last["reached_mhz"] >= 120 > first["reached_mhz"]
    assert told["closure"]["kept"] == len(told["closure"]["rounds"]) - 1
    assert told["closure"]["stopped"] == "the clock is reached"
    assert first["change"] == "" != last["change"]
    assert {part["kind"] for part in first["critical"]} >= {"quantise"}


def test_the_page_has_every_round(record):
    text = page(record, document(record))
    assert "A clock of 120 MHz was asked for" in text
    for number in range(1, len(record.closure.rounds)):
        assert f"<td>{number}</td>" in text
    assert f"<td>{len(record.closure.rounds)} (kept)</td>" in text


def test_the_table_has_every_round(record):
    lines = build_table(record).splitlines()
    assert any("120 MHz asked for" in line and line.endswith("reached") for line in lines)
    rounds = [line for line in lines if line.startswith("round ")]
    assert len(rounds) == len(record.closure.rounds)
    assert "kept" in rounds[-1]
    assert "times the delay of the device's table" in rounds[-1]


def test_without_rounds_the_table_still_says_what_was_asked_for(record):
    architecture = replace(record.hardware.design.architecture, clock_mhz=500.0)
    assert "500 MHz asked for" in (told := closure_table(architecture, record.implemented, None))
    assert told.endswith("missed")


def test_rounds_without_a_clock_are_blamed_on_the_option():
    done = CliRunner().invoke(app, ["implement", str(DESIGNS / "nile.toml"), "--rounds", "2"])
    assert done.exit_code == 1
    assert "--rounds = 2: say which clock they are to reach: architecture.clock_mhz" in done.stderr


def test_a_build_folder_keeps_its_schedule(tmp_path):
    done = CliRunner().invoke(app, ["implement", str(tmp_path), "--rounds", "2"])
    assert done.exit_code == 2
    assert "a build folder has its schedule already" in done.stderr


@pytest.mark.parametrize(
    ("derate", "problem"),
    [
        ("{ recipocal = 1.5 }", "did you mean 'reciprocal'"),
        ("{ add = 0.5 }", "add = 0.5: a number from 1 to 10"),
        ("{ add = 1e9 }", "a number from 1 to 10"),
    ],
)
def test_wrong_factors_are_told(tmp_path, derate, problem):
    path = tmp_path / "nile.toml"
    text = (DESIGNS / "nile.toml").read_text()
    path.write_text(text.replace('device = "ecp5-25k"', f'device = "ecp5-25k"\nderate = {derate}'))
    done = CliRunner().invoke(app, ["show", str(path)])
    assert done.exit_code == 1
    assert problem in done.stderr
