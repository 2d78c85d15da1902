"""A reset between two sections comes in a clock that takes a step, whoever paused before it."""

import numpy as np
import pytest

from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import compile_design
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.toolchain.simulators import Simulator, simulate_with
from kalmanhdl.verify.compare import border_of, verify
from kalmanhdl.verify.stimulus import random_sections

_RUNS = 12


@pytest.mark.parametrize(("interval", "channels"), [(3, 1), (2, 3)])
def test_no_section_ends_in_a_reset_that_never_comes(interval, channels):
    model = linear_model(
        [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    hardware = compile_design(
        Design(
            name="axis",
            model=model,
            numerics=FixedSpecification(width=12),
            architecture=Architecture(interval=interval, channels=channels),
            target=Target(device="ecp5-25k", grade=8),
        )
    )
    shown, plan = hardware.interface, hardware.plan
    simulate = simulate_with(Simulator.CXXRTL, hardware.verilog, "axis", border_of(shown), optimised=False)
    engine = Engine.of(hardware.numbers.typed, optimised=False)
    for seed in range(_RUNS):
        sections = random_sections(plan, shown, 6_000, seed)
        assert any(section.left and not section.calm for section in sections)
        verify(simulate, "axis", plan, shown, engine, sections, stimulus="random")
