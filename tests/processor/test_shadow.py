"""Double precision beside the simulator: what every instruction is off, and where it is farthest off."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_programs import DESTINATION, every_instruction
from typer.testing import CliRunner

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.cli import app
from kalmanhdl.design_file import loads
from kalmanhdl.processor.arithmetic import compute
from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.compiler.generate import compiled, rows_read, tokens
from kalmanhdl.processor.core import Core, writes
from kalmanhdl.processor.fit import fitted
from kalmanhdl.processor.instructions import FUNCTIONS, OPERATIONS, Kind, Opcode, build
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.reference_steps import reference_steps
from kalmanhdl.processor.shadow import Shadow, real_result
from kalmanhdl.processor.simulator import Machine, run

CORE = Core(form=Fixed(width=32, fraction=20), extended=True, functions=FUNCTIONS)
ARITHMETIC = [each for each in OPERATIONS.values() if each.operands[-1:] == (DESTINATION,)]
MATRIX = st.lists(st.integers(-(1 << 22), 1 << 22), min_size=9, max_size=9)
ALTITUDE = """
name = "altitude"
[model]
kind = "constant_velocity"
axes = ["up"]
T = 1.0
noise = 0.5
R = [[9.0]]
[model.initial]
kind = "two_point"
[architecture]
kind = "processor"
"""


@pytest.mark.parametrize(
    "operation",
    [each for each in ARITHMETIC if each.opcode is not Opcode.READ],
    ids=lambda each: each.opcode.name,
)
@settings(max_examples=20)
@given(MATRIX, MATRIX, MATRIX, st.integers(0, 8))
def test_an_instruction_without_rounding_is_what_it_is_within_a_last_bit(operation, a, b, c, element):
    function = element % len(FUNCTIONS)
    operands = {Kind.ELEMENT: element, Kind.EXPONENT: element - 6, Kind.FUNCTION: function, Kind.MATRIX: 0}
    instruction = build(operation.opcode, *(operands[each.kind] for each in operation.operands))
    raws, outside = compute(instruction, a, b, CORE, c)
    reals = [np.array([float(CORE.form.real(raw)) for raw in each]) for each in (a, b, c)]
    found = real_result(instruction, *reals, CORE)
    assert len(found) == len(writes(instruction, CORE))
    if not outside:
        exact = [float(CORE.form.real(raw)) for raw in raws]
        np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1.01 * float(CORE.form.resolution))


def shadowed(source, numbers, most=100):
    """A run with its shadow."""
    program = assemble(source, CORE)
    machine = Machine(CORE, *bench(CORE, [CORE.form.nearest(number) for number in numbers]))
    machine.load(program.words)
    shadow = Shadow(CORE)
    run(machine, most, watch=shadow.follow)
    return machine, shadow


def test_what_is_off_is_told_with_element_and_time():
    machine, shadow = shadowed(
        "READ 4 0\nRECIP 0 4 1\nHAD_33 1 1 2\nRECIP 0 0 3\nREAD 4 0\nRECIP 0 4 1\nHAD_33 1 1 2\nHALT",
        [3.0, 4.0],
    )
    third = shadow.deviations[1]
    assert third.off == pytest.approx(abs(1 / 3 - float(CORE.form.real(machine.core.form.nearest(1 / 3)))))
    assert (third.element, third.time, third.times, third.largest) == (4, 1, 1, pytest.approx(1 / 3))
    square = shadow.deviations[2]
    ninth = CORE.form.real(CORE.form.nearest(1 / 9))
    assert square.off == pytest.approx(float(abs(Fraction(1, 9) - ninth)), rel=1.0)
    # A quarter is exact; of zero there is the largest number, and a flag.
    assert (shadow.deviations[5].off, shadow.deviations[3].misfits) == (0.0, 1)
    np.testing.assert_array_equal(shadow.data[2], [0, 0, 0, 0, 1 / 16, 0, 0, 0, 0])


def test_every_instruction_is_followed():
    words = every_instruction(CORE)
    rng = np.random.default_rng(1)
    machine = Machine(CORE, *bench(CORE, [CORE.form.nearest(x) for x in rng.uniform(0.1, 2.0, 18)]))
    machine.load(tuple(words))
    shadow = Shadow(CORE)
    run(machine, len(words) - 3, watch=shadow.follow)
    assert {each.instruction.opcode for each in shadow.deviations.values()} == {
        each.opcode for each in ARITHMETIC
    }
    assert all(each.off < 1e-4 for each in shadow.deviations.values() if not each.misfits)


def test_rows_are_held_against_the_reference_in_the_units_of_the_model():
    fit = fitted(loads(ALTITUDE))
    z = np.cumsum(np.random.default_rng(3).normal(size=(30, 1)), axis=0)
    z[11] = np.nan
    read = tokens(fit.filter_, fit.core, rows_read(fit.core, z / fit.scaling.measurement))
    machine = Machine(fit.core, *bench(fit.core, read))
    machine.load(compiled(fit.filter_, fit.core).words)
    done = run(machine, 100_000)
    found = reference_steps(fit, read, done.sent)
    assert found.exact.shape == (30, 4)
    assert np.isnan(found.off[0]).all()
    assert found.off[1:].max() < 1e-4
    names = [name.replace("_", " ") for name in fit.given.state_names]
    assert found.names == (*names, *(f"variance of {name}" for name in names))


def test_exec_compares_a_program_with_double_precision(tmp_path):
    (tmp_path / "third.asm").write_text("READ 0 0\nRECIP 0 0 1 -- a third\nWRITE 1 0\nHALT\n")
    (tmp_path / "numbers.txt").write_text("3\n")
    call = [
        "exec",
        str(tmp_path / "third.asm"),
        "--input",
        str(tmp_path / "numbers.txt"),
        "--compare",
        "--dump",
    ]
    done = CliRunner().invoke(app, call)
    assert done.exit_code == 0, done.output
    lines = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert lines[1] == "001 RECIP 0 0 1 a third 1 0.3333 5.1e-06 1.5e-05 [0,0], time 1"
    assert lines[2] == "1 others: exact"
    assert lines[3].startswith(
        "address 001, RECIP 0 0 1 (a third): element [0,0] is 5.1e-06 off 0.333333, time 1"
    )
    assert "(1): at most 5.1e-06 off double precision" in lines
    traced = CliRunner().invoke(app, [*call, "--trace"])
    assert "RECIP 0 0 1" in traced.stdout
    assert "= 0.3333282470703125 off 5.1e-06" in " ".join(traced.stdout.split())


def test_a_folder_has_its_core_already(tmp_path):
    done = CliRunner().invoke(app, ["exec", str(tmp_path), "--width", "16"])
    assert done.exit_code == 2
    assert "a build folder has its core already" in done.output
    done = CliRunner().invoke(app, ["exec", str(tmp_path)])
    assert done.exit_code == 1
    assert "is no build folder" in done.output
