"""The Verilog against the engine, and faults that must not pass."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from equivalence import proof
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import compile_design, verify
from kalmanhdl.simulate.data import plots_from_arrays
from planted_faults import plant
from random_designs import random_design

pytestmark = [
    pytest.mark.skipif(not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler"),
    pytest.mark.filterwarnings("ignore"),
]


@pytest.fixture(scope="module")
def hardware():
    model = linear_model(
        [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    design = Design(
        name="axis",
        model=model,
        numerics=FixedSpecification(width=12),
        architecture=Architecture(interval=1, channels=3),
        target=Target(device="unit", grade=1),
    )
    return compile_design(design)


def test_every_bit_of_drawn_and_random_steps_is_equal(hardware):
    runs = verify(hardware, 4000)
    assert [run.stimulus for run in runs] == ["model", "random"]
    assert sum(run.steps for run in runs) == 4000
    assert all(run.mismatches == 0 for run in runs)


def test_real_data_are_verified_too(hardware):
    z = np.cumsum(np.random.default_rng(1).standard_normal((50, 2, 1)), axis=0)
    z[20, 0] = np.nan
    runs = verify(hardware, 200, plots_from_arrays(z, hardware.design.model))
    assert [run.stimulus for run in runs] == ["data", "model", "random"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_planted_fault_is_found_or_changes_nothing(hardware, seed):
    fault = plant(hardware.verilog, seed)
    try:
        verify(replace(hardware, verilog=fault.verilog), 20_000)
    except KalmanhdlError:
        return
    assert proof(hardware.verilog, fault.verilog, hardware.design.name, hardware.numbers.typed)


def test_a_difference_names_step_signal_and_both_values(hardware):
    line = next(line for line in hardware.verilog.splitlines() if "assign out_x_0 =" in line)
    wrong = line.replace("= ", "= 12'h001 ^ ", 1)
    message = r"axis: step 0 \(track 0\), x\[0\]: the Verilog gives .*, the engine"
    with pytest.raises(KalmanhdlError, match=message):
        verify(replace(hardware, verilog=hardware.verilog.replace(line, wrong)), 100)


def test_a_register_that_became_a_latch_is_refused(hardware):
    latch = hardware.verilog.replace(
        "endmodule", "  reg late;\n  always @* if (clk) late = rst;\nendmodule", 1
    )
    with pytest.raises(KalmanhdlError, match=r"axis: .*latch.* is a latch"):
        verify(replace(hardware, verilog=latch), 100)


def without_reset(verilog, register):
    """The Verilog with a register that reset leaves as it is."""
    source = re.search(rf"^ +{register} <= (\w+);", verilog, re.MULTILINE)[1]
    wrong, changed = re.subn(rf"(assign {source} = )rst \? \S+ : ", r"\1", verilog, count=1)
    assert changed
    return wrong


def test_a_step_that_starts_too_late_is_a_difference(hardware):
    wrong, changed = re.subn(r"(rst \? \d'h)\w+( : _1_;)", r"\g<1>00\2", hardware.verilog, count=1)
    assert changed, "the credits that there are after reset"
    with pytest.raises(KalmanhdlError, match=r"in clock \d+ after reset, and by the schedule in clock|stuck"):
        verify(replace(hardware, verilog=wrong), 400)


@pytest.mark.parametrize("register", ["valid_c1", "second_valid", "third_valid", "freed"])
def test_a_register_that_reset_forgets_is_found(hardware, register):
    with pytest.raises(KalmanhdlError):
        verify(replace(hardware, verilog=without_reset(hardware.verilog, register)), 20_000, optimised=False)


@pytest.mark.slow
@pytest.mark.parametrize("seed", np.random.default_rng().integers(0, 1 << 20, 3))
def test_random_designs_are_equal_bit_for_bit(seed):
    """A fresh sample each time; ``benchmarks/random_models.py --seed SEED --count 1`` repeats one."""
    hardware = compile_design(random_design(int(seed), max_states=3, max_measurements=2))
    assert sum(run.mismatches for run in verify(hardware, 600)) == 0
