"""A hundred thousand steps of every fixed-point algorithm: engine and Verilog agree on every bit."""

import shutil

import pytest

from every_algorithm import every_algorithm
from kalmanhdl.pipeline import compile_design, verify

DESIGNS = every_algorithm()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler")
@pytest.mark.parametrize("name", DESIGNS)
def test_every_bit_is_equal(name):
    runs = verify(compile_design(DESIGNS[name]()), 100_000)
    assert sum(run.steps for run in runs) >= 100_000
    assert all(run.mismatches == 0 for run in runs)
