"""Functions beyond arithmetic in the Verilog, against the engine, bit for bit."""

import shutil

import pytest

from function_graphs import Robot
from kalmanhdl.numerics.functions.method import Cordic, Interpolation
from kalmanhdl.rtl.filter import Filter
from kalmanhdl.rtl.interface import interface
from kalmanhdl.rtl.verilog import header, to_rtlil
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.target import device
from kalmanhdl.toolchain.cxxrtl import build_library
from kalmanhdl.toolchain.simulation import Compiled
from kalmanhdl.toolchain.yosys import rtlil_to_verilog
from kalmanhdl.verify.border import border_of
from kalmanhdl.verify.compare import verify
from kalmanhdl.verify.stimulus import Section, random_steps
from planning import planned

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler"
)
PART = device("ecp5-25k", 8)


def verified_steps(plan: Plan, count: int) -> int:
    verilog = rtlil_to_verilog(to_rtlil(Filter(plan), "robot"), "robot", header(plan, "robot"))
    library = build_library(verilog, "robot", border_of(interface(plan)), optimised=False)
    section = Section(steps=random_steps(plan.typed, count, plan.channels, 1))
    simulator = Compiled(name="cxxrtl", library=library)
    engine = Engine.of(plan.typed)
    run = verify(simulator, "robot", plan, interface(plan), engine, [section], stimulus="random")
    assert run.mismatches == 0
    return run.steps


@pytest.mark.slow
@pytest.mark.parametrize("method", [Cordic(), Interpolation(index_bits=8)])
@pytest.mark.parametrize("width", [16, 24])
def test_every_function_is_in_hardware_what_it_is_in_the_engine(width, method):
    plan = planned(Robot(width, method).typed, PART, 1, 4)
    assert not problems(plan, PART)
    assert verified_steps(plan, 3000) >= 3000


def test_the_functions_of_a_short_word_run_in_one_clock():
    plan = planned(Robot(8, None).typed, PART, 1, 1)
    assert plan.distance == 1
    assert not problems(plan, PART)
    assert verified_steps(plan, 3000) >= 3000
