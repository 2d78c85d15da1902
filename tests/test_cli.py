"""The command: what it prints, where it writes, and how it ends."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

import kalmanhdl
from kalmanhdl import build as building
from kalmanhdl.cli import app
from kalmanhdl.errors import ToolError, VerificationError

INPUTS = Path(__file__).parent / "errors"
DESIGN, DATA = str(INPUTS / "good.toml"), str(INPUTS / "good.csv")


def run(*words):
    return CliRunner().invoke(app, list(map(str, words)))


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A build without place and route."""
    out = tmp_path_factory.mktemp("builds") / "cart"
    done = run("build", DESIGN, "--data", DATA, "--out", out, "--no-place", "--steps", 2000)
    assert done.exit_code == 0, done.stderr
    return out, done


def test_the_version_is_told():
    assert run("--version").stdout == f"kalmanhdl {kalmanhdl.__version__}\n"


def test_every_command_has_help():
    commands = ("build", "simulate", "verify", "implement", "show")
    listed = run("--help").stdout
    for command in commands:
        assert command in listed
        assert run(command, "--help").exit_code == 0


@pytest.mark.slow
def test_a_build_writes_one_whole_folder(built):
    out, done = built
    files = {path.name for path in out.iterdir()}
    assert {"design.toml", "cart.v", "graph.txt", "schedule.txt"} <= files
    assert {"report.json", "report.html", "estimates.csv", "testbench", "cart.core"} <= files
    assert os.listdir(out.parent) == ["cart"]
    assert f"report: {out / 'report.html'}" in done.stdout
    report = json.loads((out / "report.json").read_text())
    assert sum(one["steps"] for one in report["verification"]) >= 2000
    assert all(one["mismatches"] == 0 for one in report["verification"])


@pytest.mark.slow
def test_a_build_does_not_overwrite(built):
    out, _ = built
    before = (out / "cart.v").stat().st_mtime_ns
    done = run("build", DESIGN, "--out", out, "--no-place")
    assert (done.exit_code, done.stderr) == (
        1,
        f"error: {out}: exists: name another folder, or replace it with --force\n",
    )
    assert (out / "cart.v").stat().st_mtime_ns == before


@pytest.mark.slow
def test_the_verilog_of_a_folder_is_what_is_verified(built):
    out, _ = built
    done = run("verify", out, "--steps", 2000)
    assert done.exit_code == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert [row[1] for row in rows] == ["stimulus", "model", "random"]
    assert all(row[-1] == "0" for row in rows[1:])
    verilog = (out / "cart.v").read_text()
    try:
        for change, words in {
            lambda text: re.sub(r"(assign update_y_0_\w+ = .*) - ", r"\1 + ", text): "the Verilog gives",
            lambda text: text.replace(" - ", " + "): "the simulated design is stuck",
            lambda text: text.replace("endmodule", "endmodul"): "yosys failed",
            lambda text: "": "yosys failed",
        }.items():
            (out / "cart.v").write_text(change(verilog))
            done = run("verify", out, "--steps", 2000)
            problem = done.stderr.splitlines()[-1]
            assert done.exit_code == 1
            assert problem.startswith("error: ")
            assert words in problem
            assert "Traceback" not in done.stderr
    finally:
        (out / "cart.v").write_text(verilog)


def test_a_folder_of_anything_else_is_not_verified(tmp_path):
    done = run("verify", tmp_path)
    assert done.exit_code == 1
    assert done.stderr.splitlines()[-1] == f"error: {tmp_path}: is no build folder: it has no design.toml"


def test_a_build_folder_without_its_verilog_is_told(tmp_path):
    (tmp_path / "design.toml").write_text((INPUTS / "good.toml").read_text())
    done = run("verify", tmp_path)
    assert done.exit_code == 1
    assert "cart.v: the Verilog of the build cannot be read: No such file or directory" in done.stderr


def test_a_simulation_prints_errors_and_writes_estimates(tmp_path):
    done = run("simulate", DESIGN, "--data", DATA, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[:3]] == ["state", "place", "speed"]
    rows = (tmp_path / "out" / "estimates.csv").read_text().splitlines()
    assert rows[0].split(",")[:4] == ["track", "step", "reference_place", "exact_place"]
    assert len(rows) == 6


def test_a_constant_takes_the_place_of_the_files():
    tables = [
        run("show", DESIGN, "--constant", value).stdout for value in ("sigma=2", "sigma=1+1", "sigma=20")
    ]
    assert tables[0] == tables[1] == run("show", DESIGN).stdout != tables[2]


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ("tau=1", "constant tau is none of the design: its constants are T, sigma"),
        ("T=1/0", "constant T = '1/0': '1/0' has no real value"),
        ("T=open('x')", "constant T = \"open('x')\": "),
    ],
)
def test_a_wrong_constant_is_told_with_what_there_is(value, problem):
    done = run("show", DESIGN, "--constant", value)
    assert done.exit_code == 1
    assert problem in done.stderr


def test_a_constant_without_value_is_a_wrong_call():
    done = run("show", DESIGN, "--constant", "T")
    assert done.exit_code == 2
    assert "write NAME=VALUE" in done.stderr


def test_show_prints_operations_bounds_formats_and_schedule():
    text = run("show", DESIGN).stdout
    for word in (
        "operations",
        "recurrence bound",
        "bound set by",
        "fixed(16, fraction=",
        "reciprocal",
        "###",
    ):
        assert word in text


def test_show_prints_texts_that_parse_back():
    from kalmanhdl.graph.text import parse_graph
    from kalmanhdl.schedule.text import parse_plan

    assert parse_graph(run("show", DESIGN, "--graph").stdout).states
    assert parse_plan(run("show", DESIGN, "--schedule").stdout).channels == 1


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_show_draws_the_schedule(tmp_path, suffix):
    out = tmp_path / f"schedule.{suffix}"
    assert run("show", DESIGN, "--out", out).exit_code == 0
    assert out.stat().st_size > 1000
    assert os.listdir(tmp_path) == [out.name]


def test_show_draws_nothing_else(tmp_path):
    assert "write a .png or .svg" in run("show", DESIGN, "--out", tmp_path / "x.docx").stderr


LITTLE = """name = "little"
[model]
kind = "linear"
F = [[1, 1], [0, 1]]
H = [[1, 0]]
Q = { diagonal = [1, 1] }
R = { diagonal = [1] }
[model.initial]
kind = "given"
x = [0, 0]
P = { diagonal = [1, 1] }
"""


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            "",
            "[architecture]\nunits = { multiply = 1 }\ninterval = 1",
            ", line 14: architecture.interval is 1",
        ),
        ("", "[architecture]\nlatency = 1", ", line 13: architecture.latency is 1"),
        ("", "[architecture]\nupdates_per_second = 1", ", line 13: [architecture] updates_per_second = 1"),
        ("Q = { diagonal = [1, 1] }", "Q = { diagonal = [1e300, 1e300] }", ", line 2: state x0 comes to"),
    ],
)
def test_a_later_stage_names_the_design_file_and_the_line(tmp_path, before, after, message):
    file = tmp_path / "little.toml"
    file.write_text(LITTLE.replace(before, after) if before else LITTLE + after + "\n")
    assert f"error: {file}{message}" in run("show", file).stderr


def test_a_difference_of_the_verilog_names_the_design_file(tmp_path, monkeypatch):
    def differs(*_, **__):
        raise VerificationError("little: step 0 differs")

    (tmp_path / "little.toml").write_text(LITTLE)
    monkeypatch.setattr(building, "planned_design", differs)
    done = run("show", tmp_path / "little.toml")
    assert done.stderr.splitlines()[-1] == f"error: {tmp_path / 'little.toml'}: little: step 0 differs"


def test_without_a_compiler_a_build_fails_before_the_work_and_says_what_helps(tmp_path, monkeypatch):
    def none():
        raise ToolError("no C++ compiler was found: install one")

    monkeypatch.setattr("kalmanhdl.toolchain.compiler.find_compiler", none)
    monkeypatch.setattr(building, "compile_design", lambda *_: pytest.fail("the work began"))
    done = run("build", DESIGN, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert done.stderr == (
        "error: no C++ compiler was found: install one, or build without verification, --no-verify\n"
    )
    assert os.listdir(tmp_path) == []


def test_an_unwritable_place_is_told_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "compile_design", lambda *_: pytest.fail("the work began"))
    (tmp_path / "file").write_text("")
    done = run("build", DESIGN, "--out", tmp_path / "file" / "out")
    assert done.exit_code == 1
    assert done.stderr.startswith(f"error: {tmp_path / 'file' / 'out'}: ")


FILES = [
    (["show", DESIGN], "--out", "x.png"),
    (["formats", DESIGN], "--out", "x.toml"),
    (["formats", DESIGN], "--picture", "x.png"),
    (["sweep", DESIGN], "--out", "x.csv"),
    (["sweep", DESIGN], "--picture", "x.svg"),
    (["image", DESIGN], "--out", "x.csv"),
    (["asm", "gone.asm"], "--out", "x.hex"),
    (["disasm", "gone.hex"], "--out", "x.asm"),
]


@pytest.mark.parametrize(("call", "option", "name"), FILES)
def test_what_is_wrong_with_a_file_to_write_is_told_before_the_work(
    tmp_path, monkeypatch, call, option, name
):
    monkeypatch.setattr("kalmanhdl.design.Design.load", lambda *_: pytest.fail("the work began"))
    file, folder = tmp_path / name, tmp_path / f"in.{name}"
    file.write_text("mine")
    folder.mkdir()
    for place, force, problem in (
        (file, [], "exists: name another file, or replace it with --force"),
        (folder, ["--force"], "is a folder: name a file"),
        (tmp_path / "nodir" / name, [], f"no folder {tmp_path / 'nodir'}: make it, or choose anoth"),
    ):
        done = run(*call, option, place, *force)
        assert (done.exit_code, done.stdout) == (1, "")
        assert done.stderr.startswith(f"error: {place}: {problem}")
    assert file.read_text() == "mine"


def test_a_file_is_replaced_by_force(tmp_path):
    out = tmp_path / "x.svg"
    out.write_text("old")
    assert run("show", DESIGN, "--out", out, "--force").exit_code == 0
    assert out.stat().st_size > 1000


def test_two_results_of_a_command_are_two_files(tmp_path):
    out = tmp_path / "x.png"
    done = run("formats", DESIGN, "--out", out, "--picture", out)
    assert done.exit_code == 2
    assert "is --out already: name another file" in done.stderr


def test_a_defect_is_told_as_one(monkeypatch):
    monkeypatch.delenv("KALMANHDL_DEBUG", raising=False)
    monkeypatch.setattr(building, "planned_design", lambda *_: {}["gone"])
    done = run("show", DESIGN)
    assert done.exit_code == 70
    assert done.stderr.startswith("error: a defect of kalmanhdl: KeyError: 'gone'")


def children(pid):
    """The processes that a process has started, and theirs."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            found += [int(child), *children(int(child))]
    return found


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_leaves_no_process_and_no_file(tmp_path, signum):
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp"), "KALMANHDL_CACHE": str(tmp_path / "cache")}
    (tmp_path / "tmp").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-m", "kalmanhdl", "build", DESIGN, "--out", str(tmp_path / "out"), "--no-place"],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    try:
        deadline = time.monotonic() + 60
        started = []
        # Yosys is running once there is a child that works in the temporary folder.
        while not started and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.1)
            started = children(process.pid) if any((tmp_path / "tmp").iterdir()) else []
        assert started
        process.send_signal(signum)
        _, errors = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert errors.splitlines()[-1] == "interrupted"
    assert "Traceback" not in errors
    assert not any(Path(f"/proc/{pid}").exists() for pid in started)
    assert os.listdir(tmp_path / "tmp") == []
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "value", "problem"),
    [
        ("--device", "unitt", "'unitt' is unknown: there are ecp5-25k, ecp5-45k, ecp5-85k"),
        ("--grade", 9, "9 is unknown: the speed grades of ecp5-25k are 6, 7, 8"),
    ],
)
def test_an_unknown_device_is_blamed_on_the_option(option, value, problem):
    done = run("implement", DESIGN, option, value)
    assert done.exit_code == 1
    assert done.stderr.splitlines()[-1] == f"error: {option} = {problem}"


@pytest.fixture
def floating(tmp_path):
    """The good design in single precision."""
    file = tmp_path / "float.toml"
    lines = Path(DESIGN).read_text().partition("[numerics]")[0]
    file.write_text(f'{lines}\n[numerics]\nkind = "float"\nformat = "single"\n')
    return file


def test_a_design_in_floating_point_is_shown_and_simulated(floating, tmp_path):
    shown = run("show", floating)
    assert shown.exit_code == 0, shown.stderr
    assert "format  float(8, 23), rounded half even" in shown.stdout
    assert "from 1.401e-45, in full from 1.175e-38, to 3.403e+38" in shown.stdout
    assert "= input z[0]" in run("show", floating, "--graph").stdout
    done = run("simulate", floating, "--data", DATA, "--out", tmp_path / "e")
    assert done.exit_code == 0, done.stderr
    assert "0 saturations, 0 inputs out of range" in done.stdout
    assert (tmp_path / "e" / "estimates.csv").exists()


@pytest.mark.parametrize("words", [["formats"], ["sweep"]])
def test_word_lengths_of_floating_point_are_refused(floating, words):
    done = run(words[0], floating, *words[1:])
    assert done.exit_code == 1
    line = floating.read_text().splitlines().index('kind = "float"') + 1
    expected = f'{floating}, line {line}: [numerics] kind = "float": word lengths and consistency'
    assert expected in done.stderr


def test_reproduce_prints_a_papers_figures_and_draws_pictures(tmp_path):
    place = tmp_path / "kumar2014"
    done = run("reproduce", "kumar2014", "--no-place", "--out", str(place))
    assert done.exit_code == 0, done.output
    assert "17.216522216" in done.stdout
    assert (place / "figures.txt").read_text() in done.stdout
    assert (place / "settling.png").read_bytes().startswith(b"\x89PNG")


def test_reproduce_names_the_papers_that_there_are():
    done = run("reproduce", "kumar2015")
    assert done.exit_code == 1
    assert "kumar2014" in done.stderr
