"""Hardware with more latency than the table asks for is bit for bit the engine too."""

from dataclasses import replace
from pathlib import Path

import pytest

from every_algorithm import every_algorithm
from kalmanhdl.design import Design
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.pipeline import compile_design, verify
from kalmanhdl.target import DERATED
from random_designs import random_design

ALL = dict.fromkeys(DERATED, 6.0)
SOME = {"operands": 6.0, "multiply": 1.5, "quantise": 2.0, "subtract": 3.0}
UNITS = {"add": 2, "subtract": 1, "multiply": 2, "divide": 1, "reciprocal": 1}


def runs(design, derate, steps=2000, **architecture):
    asked = replace(design.architecture, **architecture)
    design = replace(design, architecture=asked, target=replace(design.target, derate=derate))
    hardware = compile_design(design)
    assert any(hardware.plan.registers)
    return hardware.plan, verify(hardware, steps, optimised=False)


@pytest.mark.parametrize("derate", [ALL, SOME], ids=["all", "some"])
def test_shared_operators_choose_operands_in_two_steps(derate):
    design = random_design(3, max_states=3, max_measurements=1)
    plan, found = runs(design, derate, interval=None, units=UNITS)
    assert plan.units
    assert all(unit.steps == 2 for unit in plan.units)
    assert all(run.mismatches == 0 for run in found)


def test_iterative_operators_choose_operands_in_two_steps():
    design = random_design(3, max_states=3, max_measurements=1)
    design = replace(design, numerics=replace(design.fixed_point, division="radix2"))
    units = {"multiply": 1, "reciprocal": 1}
    kinds = ("multiply", "reciprocal")
    plan, found = runs(design, {"operands": 6.0}, interval=None, units=units, iterative=kinds)
    assert {unit.steps for unit in plan.units} == {2}
    assert {unit.busy > 1 for unit in plan.units} == {True}
    assert all(run.mismatches == 0 for run in found)


@pytest.mark.slow
def test_floating_point():
    design = Design.load(Path(__file__).parents[2] / "designs" / "nile.toml")
    design = replace(design, numerics=FloatSpecification(exponent=8, mantissa=12))
    plan, found = runs(design, ALL, units={"add": 1, "multiply": 1})
    assert {unit.steps for unit in plan.units} == {2}
    assert all(run.mismatches == 0 for run in found)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_designs(seed):
    _, found = runs(random_design(seed, max_states=4), ALL if seed % 2 else SOME)
    assert all(run.mismatches == 0 for run in found)


@pytest.mark.slow
@pytest.mark.parametrize("name", every_algorithm())
def test_every_algorithm(name):
    _, found = runs(every_algorithm()[name](), ALL)
    assert all(run.mismatches == 0 for run in found)
