"""Wrong inputs, each beside the message that it must give (tests/errors)."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from kalmanhdl.cli import app

FOLDER = Path(__file__).parent / "errors"
CASES = sorted(path.stem for path in FOLDER.glob("*.txt"))
INPUTS = {path.stem for path in FOLDER.iterdir() if path.suffix != ".txt"} - {"good"}


def complaint(case, monkeypatch):
    """What the command says of a case, and its exit code: the wrong file beside the good other one."""
    monkeypatch.chdir(FOLDER)
    design, data = f"{case}.toml", f"{case}.csv"
    design = design if Path(design).exists() else "good.toml"
    data = data if Path(data).exists() else "good.csv"
    command = ["show", design] if design != "good.toml" else ["simulate", design, "--data", data]
    done = CliRunner().invoke(app, command)
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    return lines, done.exit_code, done.stdout


def test_every_wrong_input_has_its_message():
    assert set(CASES) == INPUTS


@pytest.mark.parametrize("case", CASES)
def test_a_wrong_input_ends_in_one_message(case, monkeypatch):
    lines, code, output = complaint(case, monkeypatch)
    assert lines == [(FOLDER / f"{case}.txt").read_text().strip()]
    assert code == 1
    assert output == ""


def test_the_good_input_is_good(monkeypatch):
    assert complaint("good", monkeypatch)[1] == 0
