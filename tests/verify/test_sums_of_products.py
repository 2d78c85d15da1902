"""Units that multiply and add, at any clock and however they multiply: equal to the engine in every bit."""

import shutil
from dataclasses import replace

import pytest

from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.design import Architecture, Design
from kalmanhdl.pipeline import compile_design, verify
from kalmanhdl.schedule.plan import Plan

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler"
)
DENSE = Design.load("designs/liu2007_bierman_thornton.toml")
RADAR = Design.load("designs/lee1997.toml")
# Product, place and sum in one clock or in several; results kept in registers behind them at the fastest.
CLOCKS = (20.0, 100.0, 250.0)


UNITS = {"multiply_add": 3, "multiply": 1}


def agrees(design: Design, **asked: object) -> Plan:
    hardware = compile_design(replace(design, architecture=Architecture(units=UNITS, **asked)))
    assert hardware.plan.sharing.pairs
    assert all(run.mismatches == 0 for run in verify(hardware, 400))
    return hardware.plan


def test_operands_chosen_in_two_steps():
    slow = replace(RADAR, target=replace(RADAR.target, derate={"operands": 6.0, "multiply_add": 1.5}))
    assert all(unit.steps == 2 for unit in agrees(slow).units)


@pytest.mark.parametrize("logic", LogicProduct)
def test_without_multiplier_blocks(logic):
    agrees(RADAR, multiplier_blocks=0, multiplier=logic)


def test_of_tracks_in_turn():
    agrees(RADAR, channels=5)


@pytest.mark.slow
def test_of_a_filter_of_full_matrices():
    agrees(DENSE)


def test_registers_stand_where_the_clock_needs_them():
    """At any clock the bits are equal."""
    held = {
        clock: {plan.registers[k] - pairs for k, pairs in plan.sharing.pairs.items()}
        for clock, plan in ((clock, agrees(RADAR, clock_mhz=clock)) for clock in CLOCKS)
    }
    assert held[20.0] == {1}
    assert held[250.0] == {3}
