"""The test bench that a build ships runs on its own, agrees with the design, and finds what is wrong."""

import csv
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from find_libpython import find_libpython

from kalmanhdl.design import Architecture, Coefficients, Design, Streams, Target
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import Hardware, bench_files, compile_design
from kalmanhdl.simulate.commands import Command
from kalmanhdl.testbench.sections import sections
from planted_faults import plant
from random_designs import random_design, random_varying_model

# Programs of the interpreter's own environment, as where it is activated.
SCRIPTS = Path(sys.executable).parent


def needs(*tools):
    missing = [tool for tool in tools if shutil.which(tool) is None and not (SCRIPTS / tool).exists()]
    if "cocotb-config" in tools and find_libpython() is None:
        missing.append("a Python with its library")
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


def axis(numerics=None, model=None, device="unit", **architecture) -> Hardware:
    if model is None:
        Q = np.diag([0.0, 0.3])
        model = linear_model([[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], Q, [[2.0]], initial=two_point())
    return compile_design(
        Design(
            name="axis",
            model=model,
            numerics=numerics or FixedSpecification(width=12),
            architecture=Architecture(**architecture),
            target=Target(device=device, grade=1 if device == "unit" else 6),
        )
    )


def varying():
    return random_varying_model(np.random.default_rng(4), 2, 2)


KINDS = {
    "one_track": lambda: axis(),
    "in_turn": lambda: axis(interval=1, channels=9),
    "shared_operators": lambda: axis(channels=2, units={"multiply": 1}),
    "lanes": lambda: axis(interval=2, channels=3, lanes=3),
    "lanes_apart": lambda: axis(interval=1, channels=3, lanes=2, streams=Streams.LANE),
    "wide": lambda: axis(numerics=FixedSpecification(width=70)),
    "floating": lambda: axis(numerics=FloatSpecification(exponent=5, mantissa=10), device="ecp5-85k"),
    "loadable": lambda: axis(coefficients=Coefficients.LOADABLE, interval=2, channels=5),
    "run_time_inputs": lambda: axis(model=varying(), interval=3, channels=4),
}

QUICK = ("in_turn", "lanes_apart", "floating")


def wrong(hardware: Hardware) -> str:
    """The Verilog with a sum where there was a difference."""
    changed = re.sub(r"(assign update_\w+ = .*) - ", r"\1 + ", hardware.verilog, count=1)
    assert changed != hardware.verilog
    return changed


def written(hardware: Hardware, folder: Path, verilog: str | None = None) -> Path:
    name = hardware.design.name
    files = {**bench_files(hardware, optimised=False), f"{name}.v": verilog or hardware.verilog}
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    return folder


def run(command, folder: Path, aside: Path):
    """A command as somebody runs it who has cocotb and simulators, and no kalmanhdl."""
    poison = aside / "without"
    poison.mkdir(exist_ok=True)
    (poison / "kalmanhdl.py").write_text("raise ImportError('the test bench needs kalmanhdl')\n")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    environment |= {"PATH": f"{SCRIPTS}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(poison)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def make(target: str, folder: Path):
    return run(["make", "-C", "testbench", target], folder, folder.parent)


def rows(folder: Path, name: str):
    with (folder / "testbench" / name).open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def in_turn() -> Hardware:
    return KINDS["in_turn"]()


@needs("iverilog", "vvp", "cocotb-config")
@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=() if kind in QUICK else pytest.mark.slow) for kind in KINDS],
)
def test_the_bench_passes_in_icarus_on_its_own(kind, tmp_path):
    code, output = make("icarus", written(KINDS[kind](), tmp_path / "build"))
    assert code == 0, output
    assert len(re.findall(r"section \w+: \d+ clocks, as expected", output)) == 5


@pytest.mark.slow
@needs("verilator")
@pytest.mark.parametrize("kind", ["in_turn", "lanes_apart", "wide", "floating"])
def test_the_bench_passes_in_verilator_without_python(kind, tmp_path):
    code, output = make("verilator", written(KINDS[kind](), tmp_path / "build"))
    assert code == 0, output
    assert len(re.findall(r"section \w+: \d+ clocks, as expected", output)) == 5


@pytest.mark.slow
@needs("iverilog", "vvp", "cocotb-config")
@pytest.mark.parametrize("seed", [1, 4, 12])
def test_the_bench_of_a_random_design_passes(seed, tmp_path):
    code, output = make("icarus", written(compile_design(random_design(seed, 4, 2)), tmp_path / "build"))
    assert code == 0, output


FOUND = r"section \w+, step \d+, out_\w+, .+ \(expected\.csv, line \d+\): expected 0x\w+ \(.+\), got 0x\w+ \("


@needs("iverilog", "vvp", "cocotb-config")
def test_a_planted_fault_ends_the_run_and_is_told(in_turn, tmp_path):
    code, output = make("icarus", written(in_turn, tmp_path / "build", wrong(in_turn)))
    assert code != 0
    assert re.search(FOUND, output), output


@pytest.mark.slow
@needs("verilator")
def test_a_planted_fault_ends_the_run_in_verilator(in_turn, tmp_path):
    code, output = make("verilator", written(in_turn, tmp_path / "build", wrong(in_turn)))
    assert code != 0
    assert re.search(FOUND, output), output


@pytest.mark.slow
@needs("iverilog", "vvp", "cocotb-config")
def test_most_planted_faults_are_found(in_turn, tmp_path):
    found = []
    for seed in range(12):
        fault = plant(in_turn.verilog, seed)
        code, _ = make("icarus", written(in_turn, tmp_path / str(seed), fault.verilog))
        found.append(code != 0)
    assert sum(found) >= 9


def last(table, section):
    return max(k for k, row in enumerate(table) if row["section"] == section)


CHANGES = {
    r"expected in clock 7 after reset, got in clock \d+": lambda rows: rows[20].update(clock="7"),
    r"stuck: nothing moved for \d+ clocks.* results given": lambda rows: rows.insert(
        last(rows, "random"), dict(rows[last(rows, "random")])
    ),
    r"expected no further result after \d+, got one": lambda rows: rows.pop(last(rows, "random")),
}


@needs("iverilog", "vvp", "cocotb-config")
@pytest.mark.parametrize("words", list(CHANGES))
def test_results_too_late_too_few_and_too_many_are_told(words, in_turn, tmp_path):
    folder = written(in_turn, tmp_path / "build")
    table = rows(folder, "expected.csv")
    CHANGES[words](table)
    with (folder / "testbench" / "expected.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    code, output = make("icarus", folder)
    assert code != 0
    assert re.search(words, output), output


def test_equal_designs_have_equal_test_benches(in_turn):
    assert bench_files(in_turn, optimised=False) == bench_files(KINDS["in_turn"](), optimised=False)


@pytest.mark.parametrize("kind", ["one_track", "in_turn", "lanes", "lanes_apart"])
def test_there_is_every_command_a_missed_measurement_and_every_track(kind):
    hardware = KINDS[kind]()
    shown = hardware.interface
    found = sections(hardware.design.model, hardware.plan, shown)
    for section in found[:2]:
        steps = section.steps
        assert {*Command} - {Command.NONE} <= set(steps.commands.ravel()[steps.order].tolist())
        assert set((steps.tracks % shown.lanes).tolist()) == set(range(shown.lanes))
    missed = [~s.steps.flags["valid[0]"] & (s.steps.commands == Command.UPDATE) for s in found]
    assert all(each.any() for each in missed[1:2])
    tracks = set(np.concatenate([section.steps.tracks for section in found]).tolist())
    assert tracks == set(range(hardware.plan.channels * shown.lanes))


def test_a_design_of_long_intervals_gets_fewer_steps():
    short, long = (
        sections(h.design.model, h.plan, h.interface)
        for h in (KINDS["one_track"](), axis(interval=60, channels=3))
    )
    assert len(long[1].steps.order) < len(short[1].steps.order)


FUSESOC = {
    "lint": needs("fusesoc", "verilator"),
    "cocotb": needs("fusesoc", "iverilog", "vvp", "cocotb-config"),
    "sim": needs("fusesoc", "verilator"),
}


@pytest.mark.slow
@pytest.mark.parametrize("target", [pytest.param(name, marks=mark) for name, mark in FUSESOC.items()])
def test_fusesoc_runs_every_target(target, in_turn, tmp_path):
    folder, elsewhere = written(in_turn, tmp_path / "build"), tmp_path / "elsewhere"
    elsewhere.mkdir()
    command = ["fusesoc", "--cores-root", str(folder), "run", f"--target={target}", "axis"]
    code, output = run(command, elsewhere, tmp_path)
    assert code == 0, output
    assert target == "lint" or "section after" in output


@pytest.mark.slow
@FUSESOC["cocotb"]
def test_fusesoc_fails_where_the_design_is_wrong(in_turn, tmp_path):
    folder = written(in_turn, tmp_path / "build", wrong(in_turn))
    command = ["fusesoc", "--cores-root", str(folder), "run", "--target=cocotb", "axis"]
    code, output = run(command, tmp_path, tmp_path)
    assert code != 0
    assert re.search(FOUND, output), output
