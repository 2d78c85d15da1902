"""Designs that tests of programmable hardware share, and its simulation."""

from dataclasses import replace
from functools import cache

from kalmanhdl.arithmetic.division import LongDivision
from kalmanhdl.design import Design
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.programmable.build import bound
from kalmanhdl.programmable.verification import Bound, border_of
from kalmanhdl.programmable.verilog import verilog_of
from kalmanhdl.shape import Shape
from kalmanhdl.toolchain.simulation import Simulate
from kalmanhdl.toolchain.simulators import Simulator, simulate_with
from random_designs import random_design

ROOMY = Shape(
    units={"multiply": 2, "add": 2}, rows=512, words=128, operand_width=20, word_width=52, controls=3
)
"""What most random designs fit."""
TOP = "programmable"


def drawn(seed: int) -> Design:
    """A random design with numbers of 16 bits or less and exact division."""
    design = random_design(seed, 4, 2)
    numerics = replace(
        design.numerics,
        width=min(design.numerics.width, 16),
        classes={name: min(width, 16) for name, width in design.numerics.classes.items()},
        division=LongDivision(),
    )
    return replace(design, numerics=numerics)


@cache
def fitting(seed: int, shape: Shape = ROOMY) -> Bound:
    """The first design from a seed on that fits a shape, as an image."""
    while True:
        try:
            return bound(drawn(seed), shape)
        except KalmanhdlError:
            seed += 1000


@cache
def simulator(which: Simulator, *, optimised: bool) -> Simulate:
    """Hardware of the roomy shape that begins with some image, simulated."""
    verilog = verilog_of(TOP, fitting(0).image)
    return simulate_with(which, verilog, TOP, border_of(ROOMY), optimised=optimised)
