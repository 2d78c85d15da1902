"""The filters of liu2007 as programs: in fewer clocks than the paper's Bierman-Thornton, on one core."""

from dataclasses import replace

import pytest

from kalmanhdl.processor.checks import drawn_rows
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import tokens
from kalmanhdl.processor.peripherals import bench
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.reproduce.liu2007_processor import ALGORITHMS, PLACED, Figures, figures, program, reproduction
from kalmanhdl.toolchain.nextpnr import Implementation


@pytest.fixture(scope="module")
def programs():
    return {name: program(name, PLACED) for name in ALGORITHMS}


def test_both_are_programs_of_one_core(programs):
    taylor, thornton = programs.values()
    assert taylor.fit.core == thornton.fit.core
    assert thornton.step.clocks < 578
    assert taylor.step.clocks < thornton.step.clocks / 2


@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_program_computes_what_the_engine_does(programs, name):
    fit = programs[name].fit
    rows = drawn_rows(fit, 60)[0][:60]
    engine = Engine(fit.filter_, fit.core)
    wanted = [number for row in rows for number in engine.step(row)]
    machine = Machine(fit.core, *bench(fit.core, tokens(fit.filter_, fit.core, rows)))
    machine.load(fit.program.words)
    assert list(run(machine, 1_000_000).sent) == wanted
    assert not engine.saturated


def test_the_table_has_the_paper_s_rows_and_those_of_the_core(programs):
    placed = Implementation(
        device="ecp5-85k",
        grade=8,
        seed=1,
        tool="nextpnr of a test",
        fmax_mhz=50.0,
        luts=14000,
        ffs=3000,
        multipliers=18,
        block_rams=1,
        seconds=1.0,
        critical_path=(),
    )
    found = Figures(programs=tuple(programs.values()), steps=500, values=1234, placed=placed)
    table = reproduction(found)
    assert [row[1] for row in table.rows[:2]] == ["78", "578"]
    clocks = programs["Taylor about I"].step.clocks
    assert table.rows[2][1] == f"{clocks:g}"
    assert table.rows[2][5] == f"{20 * clocks:.0f}"
    assert "1234 values, none differed" in table.notes[1]
    bare = reproduction(replace(found, placed=None))
    assert bare.rows[2][4] == ""
    assert len(bare.notes) == len(table.notes) - 1


@pytest.mark.slow
def test_the_figures_rest_on_a_verified_core():
    found = figures(steps=30, place=False)
    assert len(found.programs) == 8
    assert found.values > 10_000
