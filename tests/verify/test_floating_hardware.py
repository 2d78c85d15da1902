"""Filters in floating point: the Verilog gives every bit of the engine."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.errors import DesignError
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


def test_a_function_without_hardware_is_refused():
    design = Design.load("designs/ekf_radar.toml")
    numerics = FloatSpecification(exponent=8, mantissa=23)
    with pytest.raises(DesignError, match="there is no floating-point hardware of the function cosine"):
        planned(replace(design, numerics=numerics), numbers_of(replace(design, numerics=numerics)))
