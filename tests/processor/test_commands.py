"""The commands asm, disasm and exec."""

import re
from pathlib import Path
from shutil import which
from subprocess import run

import pytest
from typer.testing import CliRunner

from kalmanhdl.cli import app

HERE = Path(__file__).parent
SUMS = """
.text
TURN: READ   0 X
      ADD_33 X SUM SUM
      WRITE  SUM 0
      JUMP_U TURN
.data
X:
SUM:
"""


def call(*arguments):
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture
def sums(tmp_path):
    (tmp_path / "sums.asm").write_text(SUMS)
    (tmp_path / "numbers.txt").write_text("1.5, 2 # and\n-0.25\n")
    return tmp_path


def test_asm_writes_the_image_of_appendix_b(tmp_path):
    out = tmp_path / "b.hex"
    assert call("asm", HERE / "appendix_b.asm", "--out", out)[0] == 0
    assert out.read_text() == (HERE / "appendix_b.hex").read_text()
    assert call("asm", HERE / "appendix_b.asm", "--out", out)[0] == 1
    assert call("asm", HERE / "appendix_b.asm", "--out", out, "--force")[0] == 0


def test_disasm_gives_a_source_of_the_same_image(tmp_path):
    _, source, _ = call("disasm", HERE / "appendix_b.hex")
    (tmp_path / "again.asm").write_text(source)
    assert call("asm", tmp_path / "again.asm")[1] == (HERE / "appendix_b.hex").read_text()


def test_exec_runs_to_the_end_of_its_input(sums):
    code, out, said = call("exec", sums / "sums.asm", "--input", sums / "numbers.txt")
    assert (code, out.split()) == (0, ["1.5", "3.5", "3.25"])
    assert said.strip() == "the input is exhausted: 12 instructions, 96 clocks"


def test_exec_traces_stops_and_dumps(sums):
    options = ("--input", sums / "numbers.txt", "--trace", "--until", "TURN", "--dump")
    _, out, said = call("exec", sums / "sums.asm", *options)
    lines = out.splitlines()
    assert lines[0].split() == ["8", "0", "TURN:", "READ", "0", "0", "0[0]", "=", "1.5"]
    assert lines[4:6] == ["X (0)", "  1.5  0.0  0.0"]
    assert said.strip() == "stopped at address 0: 4 instructions, 32 clocks"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--until", "TRN"), "--until TRN: the program has no such label or address: did you mean 'TURN'?"),
        (
            ("--width", "40"),
            "core: fixed(40, fraction=16): the words of a core are signed and have 8 to 32 bits",
        ),
        (("--width", "8"), "core: fixed(8, fraction=16): its point stands inside the word, 0 to 8"),
    ],
)
def test_a_wrong_option_has_one_message(sums, arguments, message):
    code, _, said = call("exec", sums / "sums.asm", *arguments)
    assert (code, said.strip()) == (1, f"error: {message}")


def test_numbers_that_are_none_or_do_not_fit_are_refused(sums):
    (sums / "numbers.txt").write_text("1\nx")
    said = call("exec", sums / "sums.asm", "--input", sums / "numbers.txt")[2]
    assert said.strip().endswith("numbers.txt, line 2: 'x' is no number")
    (sums / "numbers.txt").write_text("1e9")
    said = call("exec", sums / "sums.asm", "--input", sums / "numbers.txt")[2]
    assert "line 1: '1e9' is outside fixed(32, fraction=16), -32768 to 32768: scale the numbers" in said


def test_an_image_that_cannot_run_is_refused_by_address(sums):
    (sums / "bad.hex").write_text("00000000\nF8000000\n")
    code, _, said = call("exec", sums / "bad.hex")
    assert code == 1
    assert said.strip().endswith(
        "bad.hex: address 1: word 0xF8000000: there is no instruction with the opcode 0x1F"
    )


ALTITUDE = """
name = "altitude"
[model]
kind = "constant_velocity"
axes = ["up"]
T = 1
noise = 0.5
R = [[9.0]]
measurement_range = [[0, 200]]
[model.initial]
kind = "two_point"
"""


@pytest.fixture
def altitude(tmp_path):
    (tmp_path / "altitude.toml").write_text(ALTITUDE)
    (tmp_path / "altitude.csv").write_text("up_plot\n0\n\n1.5\n3.25\n\n8\n9.5\n12\n")
    return tmp_path


def test_compile_makes_a_program_that_exec_runs(altitude):
    arguments = ("compile", altitude / "altitude.toml", "--data", altitude / "altitude.csv")
    code, out, _ = call(*arguments, "--out", altitude / "made")
    assert code == 0
    assert out.startswith("altitude: 114 words of program for matrices of 3 by 3 of fixed(32, fraction=16)")
    assert "estimates at most 8.7" in out
    made = altitude / "made"
    _, found, said = call("exec", made / "program.hex", "--input", made / "input.txt")
    assert found.split() == (made / "expected.txt").read_text().split()
    # A start takes two plots in succession: the first plot here has no second.
    assert len(found.split()) == 6 * 4
    assert "did not fit" not in said
    assert (made / "core.v").read_text().startswith("// controller: a programmable matrix processor")


def made_and_run(target, altitude):
    """What the test bench says of the expected numbers, and of one wrong among them."""
    out = altitude / "made"
    call("compile", altitude / "altitude.toml", "--data", altitude / "altitude.csv", "--out", out)
    right = run(["make", target], cwd=out, capture_output=True, text=True)
    lines = (out / "expected.hex").read_text().splitlines()
    lines[7] = "00000001"
    (out / "expected.hex").write_text("\n".join([*lines, ""]))
    return right, run(["make", target], cwd=out, capture_output=True, text=True)


@pytest.mark.parametrize(
    "target",
    [
        pytest.param("icarus", marks=pytest.mark.skipif(which("iverilog") is None, reason="no Icarus")),
        pytest.param(
            "verilator",
            marks=[
                pytest.mark.slow,
                pytest.mark.skipif(which("verilator") is None, reason="no Verilator"),
            ],
        ),
    ],
)
def test_the_test_bench_passes_and_finds_a_wrong_number(target, altitude):
    right, wrong = made_and_run(target, altitude)
    assert "24 outputs, 0 wrong" in right.stdout
    assert right.returncode == 0
    assert re.search(r"output 7 is [0-9a-f]{8} and should be 00000001", wrong.stdout)
    assert "24 outputs, 1 wrong" in wrong.stdout
    assert wrong.returncode != 0


def test_what_cannot_be_compiled_is_refused(altitude):
    (altitude / "two.csv").write_text("track,up_plot\na,1\nb,2\n")
    arguments = ("compile", altitude / "altitude.toml", "--out", altitude / "made")
    said = call(*arguments, "--data", altitude / "two.csv")[2]
    assert said.strip().endswith("two.csv: has 2 tracks, and a program filters one: give one alone")
    assert not (altitude / "made").exists()
