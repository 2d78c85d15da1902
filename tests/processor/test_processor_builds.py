"""Designs with ``[architecture] kind = "processor"``: built whole, and refused with the key's name."""

import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from kalmanhdl.cli import app
from kalmanhdl.design import Design
from kalmanhdl.design_file import dumps, loads
from kalmanhdl.errors import DesignError, VerificationError
from kalmanhdl.pipeline import compile_design
from kalmanhdl.processor.checks import drawn_rows
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import tokens
from kalmanhdl.processor.fit import fitted
from kalmanhdl.processor.follow import follow, rows_of
from kalmanhdl.processor.instructions import Opcode
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.simulators import bench_runs
from kalmanhdl.processor.step import step_of
from kalmanhdl.processor.verilog import core_verilog
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.toolchain.simulators import Simulator

RADAR = """
name = "radar"
[model]
kind = "linear"
state = ["range", "range_rate", "bearing", "bearing_rate"]
measurement = ["range_plot", "bearing_plot"]
F = [[1, "T", 0, 0], [0, 1, 0, 0], [0, 0, 1, "T"], [0, 0, 0, 1]]
H = [[1, 0, 0, 0], [0, 0, 1, 0]]
Q = { diagonal = [0, 330.0, 0, 1.3e-8] }
R = { diagonal = [1.0e6, 2.9e-4] }
constants = { T = 15.0 }
[model.initial]
kind = "two_point"
[architecture]
kind = "processor"
"""
ALTITUDE = """
name = "altitude"
[model]
kind = "constant_velocity"
T = 1.0
noise = 0.5
R = [[9.0]]
[model.initial]
kind = "two_point"
[architecture]
kind = "processor"
width = 24
matrices = 32
program_words = 128
"""


def test_a_design_of_any_units_is_fitted_to_a_core():
    fit = fitted(loads(RADAR))
    assert (fit.core.size, fit.core.multipliers, fit.core.form.width) == (4, 16, 32)
    z = np.cumsum(np.random.default_rng(1).normal(scale=300.0, size=(80, 2)), axis=0) * [1.0, 1e-4]
    z[30] = z[41, 0] = np.nan
    plots = plots_from_arrays(z, fit.given)
    (rows,) = rows_of(fit.core, fit.given, fit.scaling, plots)
    engine = Engine(fit.filter_, fit.core)
    wanted = [number for row in rows for number in engine.step(row)]
    machine = Machine(fit.core, *bench(fit.core, tokens(fit.filter_, fit.core, rows)))
    machine.load(fit.program.words)
    assert list(run(machine, 1_000_000).sent) == wanted
    assert not engine.saturated
    assert not machine.saturated
    found = follow(fit.filter_, fit.core, fit.given, fit.design.algorithm, fit.scaling, plots)
    assert (found.saturations, found.clipped) == (0, 0)
    np.testing.assert_allclose(found.exact.x, found.reference.x, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(found.exact.P, found.reference.P, rtol=1e-3, atol=1e-9)
    np.testing.assert_array_equal(
        found.exact.x[found.valid],
        np.reshape(wanted, (80, 8))[1:, :4] * 2.0**-fit.core.form.fraction * fit.scaling.state,
    )


def test_a_file_with_a_processor_is_written_and_read_again():
    design = loads(ALTITUDE)
    assert loads(dumps(design)).processor == design.processor
    assert design.processor.program_words == 128


@pytest.mark.slow
@pytest.mark.parametrize("multipliers", [0, 4])
def test_a_design_is_built_from_file_to_verified_core(tmp_path, multipliers):
    (tmp_path / "altitude.toml").write_text(ALTITUDE + f"multipliers = {multipliers}\n")
    z = np.cumsum(np.random.default_rng(2).normal(size=30)) + np.arange(30)
    lines = [f"{value:.3f}" if k != 17 else "" for k, value in enumerate(z)]
    (tmp_path / "altitude.csv").write_text(
        "x_plot\n" + "\n".join(f"{line}," for line in lines).replace(",", "") + "\n"
    )
    out = tmp_path / "made"
    call = ["build", str(tmp_path / "altitude.toml"), "--data", str(tmp_path / "altitude.csv")]
    done = CliRunner().invoke(app, [*call, "--out", str(out), "--no-place", "--steps", "60"])
    assert done.exit_code == 0, done.output
    report = json.loads((out / "report.json").read_text())
    assert report["architecture"] == "processor"
    assert [one["mismatches"] for one in report["verification"]] == [0, 0]
    assert report["verification"][0]["steps"] == 60
    assert max(report["accuracy"]["off_reference"]) < 0.1
    if multipliers:
        assert report["program"]["clocks_per_step"] < 0.2 * 8 * report["program"]["instructions_per_step"] * 2
    if shutil.which("iverilog"):
        subprocess.run(["iverilog", "-o", "bench", "testbench.v", "core.v"], cwd=out, check=True)
        found = subprocess.run(["vvp", "bench"], cwd=out, check=True, capture_output=True, text=True)
        assert "outputs, 0 wrong" in found.stdout
    names = {path.name for path in out.iterdir()}
    assert names >= {"report.html", "estimates.csv", "step.png", "step.svg", "track.png", "program.lst"}
    _verify_the_folder(out)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("iverilog"), reason="no Icarus Verilog")
def test_tracks_go_through_the_test_bench_one_after_the_other():
    fit = fitted(loads(ALTITUDE))
    verilog = core_verilog(fit.core)
    tracks = drawn_rows(fit, 40)
    short = (tracks[0][:17], tracks[1][:30], tracks[2])
    found = bench_runs(fit, verilog, short, 40, Simulator.ICARUS)
    assert (found.steps, found.outputs) == (40, 40 * len(fit.filter_.outputs))
    # A program that begins otherwise is seen to give something else.
    words = fit.program.words
    other = replace(fit, program=replace(fit.program, words=(*words[:-2], words[-1], words[-1])))
    with pytest.raises(VerificationError, match="icarus: "):
        bench_runs(other, verilog, short, 40, Simulator.ICARUS)


def _verify_the_folder(out):
    """What stands in a folder is verified, and told in its report; a program that was changed is found."""
    verify = ["verify", str(out), "--steps", "25"]
    done = CliRunner().invoke(app, verify)
    assert done.exit_code == 0, done.output
    assert "25 steps, 100 outputs of engine and simulator" in done.output
    if shutil.which("iverilog"):
        done = CliRunner().invoke(app, [*verify, "--simulator", "icarus"])
        assert "25 steps, 100 outputs of engine and Verilog equal in icarus" in done.output
        report = json.loads((out / "report.json").read_text())
        assert [one["simulator"] for one in report["verification"]] == ["cxxrtl", "cxxrtl", "icarus"]
    words = (out / "program.hex").read_text().splitlines()
    at = next(k for k, word in enumerate(words) if int(word, 16) >> 27 == Opcode.MADD_31.value)
    words[at] = f"{(int(words[at], 16) & (1 << 27) - 1) | Opcode.MSUB_31.value << 27:08X}"
    (out / "program.hex").write_text("\n".join(words) + "\n")
    done = CliRunner().invoke(app, verify)
    assert done.exit_code == 1
    assert "in the simulator and" in done.output


def test_a_step_is_told_instruction_by_instruction():
    step = step_of(fitted(loads(ALTITUDE)))
    assert step.instructions == len(step.rows)
    assert step.rows[0].first == 0
    assert max(row.last for row in step.rows) <= step.clocks + 2
    assert {row.does for row in step.rows} >= {"predict: F P", "update: 1 / S", "update: x"}
    assert [row.unit for row in step.rows if row.does == "update: 1 / S"] == ["reciprocals"]
    slow = step_of(fitted(loads(ALTITUDE + "multipliers = 0\n")))
    assert slow.clocks == 8 * slow.instructions
    assert [row.first for row in slow.rows] == [8 * k for k in range(len(slow.rows))]


def test_simulate_filters_every_track_of_the_data(tmp_path):
    (tmp_path / "altitude.toml").write_text(ALTITUDE)
    (tmp_path / "plots.csv").write_text("track,x_plot\na,1\na,2.5\na,\na,4\nb,-3\nb,-4\nb,-6\n")
    call = ["simulate", str(tmp_path / "altitude.toml"), "--data", str(tmp_path / "plots.csv")]
    done = CliRunner().invoke(app, [*call, "--out", str(tmp_path / "made")])
    assert done.exit_code == 0, done.output
    assert "every number fitted the core's format" in done.output
    table = (tmp_path / "made" / "estimates.csv").read_text().splitlines()
    assert len(table) == 1 + 7
    # A start takes two rows.
    assert [line.split(",")[2] == "" for line in table[1:]] == [True, False, False, False, True, False, False]


def test_show_prints_listing_and_clocks(tmp_path):
    (tmp_path / "altitude.toml").write_text(ALTITUDE)
    done = CliRunner().invoke(app, ["show", str(tmp_path / "altitude.toml")])
    assert done.exit_code == 0, done.output
    assert "-- update: 1 / S" in done.output
    assert "instructions in" in done.output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ALTITUDE.replace("width", "widht"), "widht"),
        (
            ALTITUDE.replace("width = 24", "width = 40"),
            r"line 12: \[architecture\] width = 40: an integer from 8",
        ),
        (ALTITUDE.replace("= 32", "= 33"), r"\[architecture\] matrices = 33: a power of two"),
        (ALTITUDE.replace('"processor"', '"procesor"'), r"\[architecture\] kind = 'procesor' is unknown"),
    ],
)
def test_what_is_wrong_in_the_file_is_refused(text, message):
    with pytest.raises(DesignError, match=message):
        loads(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            ALTITUDE + "multipliers = 3\n",
            r"\[architecture\] multipliers = 3: a multiple of the matrices' size, 2",
        ),
        (ALTITUDE + "size = 16\nfraction = 24\n", r"\[architecture\] kind = \"processor\": the constant"),
        (ALTITUDE.replace("= 128", "= 16"), r"\[architecture\] kind = \"processor\": the filter's program"),
        (ALTITUDE.replace("= 32", "= 8"), r"\[architecture\] kind = \"processor\": the filter needs"),
        (
            ALTITUDE + '[algorithm]\nkind = "scheduled"\n',
            r'kind = "processor": \[algorithm\] "scheduled" has a program for the steady gain alone',
        ),
    ],
)
def test_what_does_not_fit_the_core_is_refused(text, message):
    with pytest.raises(DesignError, match=message):
        fitted(loads(text))


def test_hardware_of_its_own_is_not_made_of_a_design_with_a_processor():
    with pytest.raises(DesignError, match=r'\[architecture\] kind = "processor": the filter is a program'):
        compile_design(loads(ALTITUDE))
    assert isinstance(loads(ALTITUDE), Design)
