"""The experiment of bhatia2012: appendix A as a program of the paper's processor."""

import numpy as np
import pytest

from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.core import checked
from kalmanhdl.processor.instructions import PAPER
from kalmanhdl.processor.rtl_simulation import RtlSimulation
from kalmanhdl.processor.verilog import core_verilog
from kalmanhdl.reproduce.bhatia2012 import (
    CORE,
    by_hand,
    figures,
    filtering,
    moving_average,
    reproduction,
    source,
)
from kalmanhdl.reproduce.facts import facts


@pytest.fixture(scope="module")
def runs():
    program = assemble(source(), CORE)
    found = []
    for R in (facts("bhatia2012")["R"], facts("bhatia2012")["R_wrong"]):
        with RtlSimulation(CORE, core_verilog(CORE), optimised=False) as rtl:
            found.append(filtering(program, rtl, R))
    return found


def test_the_program_has_the_papers_instructions_alone():
    opcodes = {instruction.opcode for instruction in checked(assemble(source(), CORE).words, CORE)}
    assert opcodes <= {operation.opcode for operation in PAPER}


def test_the_processor_follows_appendix_a(runs):
    right, wrong = runs
    assert right.exact.shape == right.reference.shape == (49, 3)
    assert not right.saturated
    np.testing.assert_allclose(right.exact[:, 0], right.reference[:, 0], atol=2e-5)
    np.testing.assert_allclose(right.exact[:, 1:], right.reference[:, 1:], atol=1e-4)
    # 1/M of the first step, 1/100, has a resolution of 2^-24 here, and the gain is within 6e-6 of one.
    np.testing.assert_allclose(wrong.exact, wrong.reference, atol=5e-3)
    assert min(run.compared for run in runs) > 100_000


def test_the_filter_settles_within_ten_iterations_as_figure_22_has_it(runs):
    data = facts("bhatia2012")
    right, wrong = (run.exact[:, 0] for run in runs)
    assert np.abs(right[data["settled_after"] - 2 :] - data["true_value"]).max() < 0.035
    average = moving_average()[10:-1]
    assert np.std(right[9:]) < np.std(wrong[9:]) < np.std(average)


def test_the_gain_and_covariance_fall_as_figures_23_and_24_have_them():
    reference = by_hand(facts("bhatia2012")["R"])
    assert reference[0, 2] > 0.98
    assert np.all(np.diff(reference[:, 1:], axis=0) < 0)


@pytest.mark.slow
def test_every_row_has_every_column_and_the_core_is_smaller_than_the_papers():
    found = figures()
    handed = reproduction(found)
    assert {len(row) for row in handed.rows} == {len(handed.columns)}
    assert len(handed.charts) == 4
    paper, here = facts("bhatia2012")["hardware"], found.synthesis
    assert here.ffs <= paper["slice_registers"]
    assert here.luts <= paper["slice_luts"]
    assert here.multipliers <= paper["dsp48e1"]
