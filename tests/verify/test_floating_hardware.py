"""Filters in floating point: the Verilog gives every bit of the engine."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.errors import DesignError, ScheduleError
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.pipeline import compile_design, numbers_of, planned, verify
from kalmanhdl.schedule.text import parse_plan, print_plan
from random_designs import random_design

pytestmark = [
    pytest.mark.skipif(not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler"),
    pytest.mark.filterwarnings("ignore"),
]
LEE = Design.load("designs/lee1997.toml")


def floating(seed, max_states=2):
    random = np.random.default_rng(seed)
    design = random_design(seed, max_states=max_states, max_measurements=1)
    numerics = FloatSpecification(
        exponent=int(random.integers(6, 9)),
        mantissa=int(random.integers(3, 24)),
        rounding=random.choice([Rounding.HALF_EVEN, Rounding.TOWARD_ZERO]),
        subnormals=bool(random.random() < 0.5),
        fused=bool(random.random() < 0.5),
    )
    return replace(design, numerics=numerics)


def one_axis(numerics, **architecture):
    model = linear_model(
        [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    return Design(
        name="axis",
        model=model,
        numerics=numerics,
        architecture=Architecture(**architecture),
        target=Target(device="ecp5-25k", grade=8),
    )


@pytest.mark.parametrize("fused", [False, True])
def test_every_bit_is_equal(fused):
    numerics = FloatSpecification(exponent=5, mantissa=4, fused=fused)
    runs = verify(compile_design(one_axis(numerics, interval=1, channels=40)), 600)
    assert [run.mismatches for run in runs] == [0, 0]


@pytest.mark.parametrize("channels", [1, 5])
def test_operations_that_take_turns_are_equal(channels):
    numerics = FloatSpecification(exponent=5, mantissa=4)
    units = {"add": 1, "multiply": 1, "divide": 1}
    hardware = compile_design(one_axis(numerics, units=units, channels=channels))
    assert hardware.plan.sharing.counts == {"add": 1, "multiply": 1}
    assert all(run.mismatches == 0 for run in verify(hardware, 600))


def test_reciprocals_take_turns():
    numerics = FloatSpecification(exponent=8, mantissa=4)
    units = Architecture(units={"add": 1, "multiply": 1, "reciprocal": 1})
    hardware = compile_design(replace(LEE, numerics=numerics, architecture=units))
    assert "reciprocal" in hardware.plan.sharing.counts
    assert all(run.mismatches == 0 for run in verify(hardware, 300))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_filters_are_equal(seed):
    design = floating(seed, max_states=3 if seed % 3 == 0 else 2)
    assert all(run.mismatches == 0 for run in verify(compile_design(design), 3000))


@pytest.mark.slow
@pytest.mark.parametrize("subnormals", [True, False])
def test_lee1997_in_single_precision_is_equal(subnormals):
    numerics = FloatSpecification(exponent=8, mantissa=23, subnormals=subnormals)
    hardware = compile_design(replace(LEE, numerics=numerics))
    assert all(run.mismatches == 0 for run in verify(hardware, 10_000))


def test_a_plan_in_floating_point_is_read_back():
    design = one_axis(FloatSpecification(exponent=6, mantissa=7, fused=True), interval=1, channels=8)
    plan = planned(design, numbers_of(design))
    assert plan.typed.fused
    assert parse_plan(print_plan(plan)) == plan


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dcmkf_radar", "ekf_radar"])
def test_functions_take_turns_on_the_operators_that_there_are(name):
    numerics = FloatSpecification(exponent=8, mantissa=7)
    units = {"add": 2, "multiply": 2, "divide": 1}
    design = replace(Design.load(f"designs/{name}.toml"), numerics=numerics)
    architecture = Architecture(units=units, solver_seconds=0)
    hardware = compile_design(replace(design, architecture=architecture))
    assert all(run.mismatches == 0 for run in verify(hardware, 1000))


def test_operators_take_as_many_clocks_as_asked():
    clocks = {"add": 7, "multiply": 5}
    numerics = FloatSpecification(exponent=5, mantissa=4)
    design = one_axis(numerics, units={"add": 1}, clocks=clocks, clock_mhz=50)
    hardware = compile_design(design)
    plan, operations = hardware.plan, hardware.plan.typed.graph.operations
    held = {type(o).__name__: plan.registers[k] for k, o in enumerate(operations)}
    assert (held["Add"], held["Subtract"], held["Multiply"]) == (6, 6, 4)
    assert parse_plan(print_plan(plan)) == plan
    assert all(run.mismatches == 0 for run in verify(hardware, 200))


def test_clocks_that_cannot_be_are_refused():
    numerics = FloatSpecification(exponent=5, mantissa=4)
    design = one_axis(numerics, clocks={"add": 60})
    with pytest.raises(ScheduleError, match=r"architecture.clocks.add is 60: in float\(5, 4\) it takes \d+"):
        planned(design, numbers_of(design))
    design = one_axis(numerics, interval=1, clocks={"add": 7})
    with pytest.raises(ScheduleError, match=r"with architecture\.clocks the loop of the states takes"):
        planned(design, numbers_of(design))
    fixed = replace(LEE, architecture=Architecture(clocks={"add": 7}))
    with pytest.raises(DesignError, match="clocks are for"):
        planned(fixed, numbers_of(fixed))


def test_a_latency_is_met_on_the_units_that_are_given():
    units = {"add": 1, "multiply": 1}
    numerics = FloatSpecification(exponent=5, mantissa=4)
    free = one_axis(numerics, units=units, solver_seconds=0)
    latency = planned(free, numbers_of(free)).latency
    held = one_axis(numerics, units=units, latency=latency, solver_seconds=0)
    assert planned(held, numbers_of(held)).latency <= latency
    short = one_axis(numerics, units=units, latency=9, solver_seconds=0)
    with pytest.raises(ScheduleError, match=r"architecture\.latency is 9: with these units"):
        planned(short, numbers_of(short))
