"""Designs with ``[architecture] control = "writable"``: written, built, verified, and loaded with others."""

import csv
import json

import pytest
from typer.testing import CliRunner

from kalmanhdl.cli import app
from kalmanhdl.design_file import dumps, loads
from kalmanhdl.errors import DesignError
from kalmanhdl.pipeline import compile_design
from kalmanhdl.shape import Shape

ALTITUDE = """
name = "altitude"
[model]
kind = "constant_velocity"
T = 1.0
noise = 0.5
R = [[9.0]]
measurement_range = [[0, 1000]]
[model.initial]
kind = "two_point"
"""
LEVEL = """
name = "level"
[model]
kind = "linear"
F = [[1]]
H = [[1]]
Q = [[1469.1]]
R = [[15099]]
measurement_range = [[0, 2000]]
[model.initial]
kind = "given"
x = [0]
P = [[1e6]]
[algorithm]
kind = "joseph"
"""
WRITABLE = '[architecture]\ncontrol = "writable"\n'


def called(*arguments):
    done = CliRunner().invoke(app, [str(each) for each in arguments])
    return done.exit_code, done.stdout, done.stderr


def test_a_shape_has_the_ports_of_its_model_and_is_written_again():
    design = loads(ALTITUDE + WRITABLE + "units = { multiply = 2 }\nrows = 512\n")
    assert design.shape == Shape(
        units={"multiply": 2, "add": 1, "reciprocal": 1}, rows=512, states=2, measurements=1, controls=0
    )
    assert loads(dumps(design)).shape == design.shape


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("channels = 4", r'channels: control = "writable" is one track'),
        ("lanes = 2", r'lanes: control = "writable" is one track'),
        ('coefficients = "loadable"', r"coefficients: .* whose numbers are in its image"),
        ("rows = 100", r"rows = 100: a power of two from 16 to 4096"),
        ("word_width = 30", r"word_width = 30: a product has 37 bits"),
        ("units = { divide = 1 }", r"divide is no unit of a programmable datapath"),
        ("units = { reciprocal = 2 }", r"reciprocal = 2: an integer from 1 to 1"),
        ("depth = 3", "depth is an unknown key"),
        ('[numerics]\nkind = "float"\nformat = "half"', r'control = "writable" is for fixed point'),
    ],
)
def test_what_a_shape_cannot_be_is_refused(keys, message):
    with pytest.raises(DesignError, match=message):
        loads(ALTITUDE + WRITABLE + keys)


def test_a_word_for_control_is_known():
    with pytest.raises(DesignError, match=r"control = 'soft': valid are fixed, writable"):
        loads(ALTITUDE + '[architecture]\ncontrol = "soft"\n')


def test_hardware_of_its_own_is_refused():
    with pytest.raises(DesignError, match=r'control = "writable": only build, show, verify'):
        compile_design(loads(ALTITUDE + WRITABLE))


def test_a_build_takes_the_image_of_another_design(tmp_path):
    (tmp_path / "altitude.toml").write_text(ALTITUDE + WRITABLE)
    (tmp_path / "level.toml").write_text(LEVEL)
    code, shown, _ = called("show", tmp_path / "altitude.toml")
    assert code == 0
    assert "of 256 rows" in shown
    built = tmp_path / "built"
    code, told, error = called(
        "build", tmp_path / "altitude.toml", "--out", built, "--no-place", "--steps", 60
    )
    assert (code, error.count("error")) == (0, 0)
    assert "mismatches" in told
    names = {
        "altitude.v",
        "design.toml",
        "graph.txt",
        "image.csv",
        "ports.txt",
        "report.json",
        "schedule.txt",
    }
    assert names <= {path.name for path in built.iterdir()}
    report = json.loads((built / "report.json").read_text())
    assert report["verification"][0]["mismatches"] == 0
    assert report["image"]["clocks_per_step"] == report["image"]["rows"] + 3
    code, told, _ = called("verify", built, "--steps", 40, "--seed", 3)
    assert code == 0
    assert json.loads((built / "report.json").read_text())["verification"][0]["steps"] == 40
    image = tmp_path / "image.csv"
    code, told, _ = called("image", built, "--model", tmp_path / "level.toml", "--out", image, "--verify", 60)
    assert code == 0
    ports, _, table = told.partition("\n\n")
    assert [line.split()[:2] for line in ports.splitlines()[1:3]] == [["in_z_0", "z[0]"], ["out_x_0", "x[0]"]]
    verified = [line.split()[1:3] for line in table.splitlines()[1:]]
    assert verified == [["altitude,", "configured"], ["level,", "written"], ["altitude,", "written"]]
    rows = list(csv.DictReader(image.read_text().splitlines()))
    assert (rows[-1]["address"], rows[-1]["place"]) == ("0", "last row")


def test_an_image_that_does_not_fit_names_the_other_design(tmp_path):
    (tmp_path / "altitude.toml").write_text(ALTITUDE + WRITABLE)
    (tmp_path / "level.toml").write_text(LEVEL + "[numerics]\nwidth = 30\n")
    code, _, error = called("image", tmp_path / "altitude.toml", "--model", tmp_path / "level.toml")
    assert code == 1
    assert f"error: {tmp_path / 'level.toml'}: " in error
    assert "bits, and ports" in error


def test_only_writable_hardware_takes_images(tmp_path):
    (tmp_path / "altitude.toml").write_text(ALTITUDE)
    code, _, error = called("image", tmp_path / "altitude.toml")
    assert code == 1
    assert "nothing can be loaded" in error
