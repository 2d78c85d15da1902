"""Every quotient of twelve bits by twelve bits, simulated, against NumPy's integers."""

import shutil

import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib.data import StructLayout
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.divider import LongDivider
from kalmanhdl.rtl.flow import SkidBuffer
from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.toolchain.cxxrtl import build_library
from kalmanhdl.toolchain.harness import Border, Stream
from kalmanhdl.toolchain.simulation import Simulation
from kalmanhdl.toolchain.yosys import rtlil_to_verilog

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler"
)
WIDTH = 12
FORM = Fixed(width=12, fraction=5)
BORDER = Border(
    source=Stream(
        valid="in_valid", ready="in_ready", payload=(("in_dividend", WIDTH), ("in_divisor", WIDTH))
    ),
    sink=Stream(valid="out_valid", ready="out_ready", payload=(("out_quotient", WIDTH), ("out_outside", 1))),
)


class Divided(Component):
    """A divider between two streams."""

    def __init__(self, core: LongDivider) -> None:
        self.core = core
        ins = {"in_valid": In(1), "in_dividend": In(WIDTH), "in_divisor": In(WIDTH), "out_ready": In(1)}
        outs = {"in_ready": Out(1), "out_valid": Out(1), "out_quotient": Out(WIDTH), "out_outside": Out(1)}
        super().__init__(ins | outs)

    def elaborate(self, platform):
        m = Module()
        m.submodules.core = core = self.core
        m.submodules.skid = skid = SkidBuffer(StructLayout({"dividend": WIDTH, "divisor": WIDTH}))
        m.d.comb += [
            skid.i.valid.eq(self.in_valid),
            skid.i.payload.dividend.eq(self.in_dividend),
            skid.i.payload.divisor.eq(self.in_divisor),
            self.in_ready.eq(skid.i.ready),
            core.dividend.eq(skid.o.payload.dividend),
            core.divisor.eq(skid.o.payload.divisor),
            self.out_valid.eq(skid.o.valid),
            self.out_quotient.eq(core.quotient),
            self.out_outside.eq(core.outside),
            skid.o.ready.eq(self.out_ready),
        ]
        return m


def defined(dividend, divisor, rounding: Rounding):
    """The quotients and whether they fit, in 64-bit integers."""
    scaled, by = dividend << FORM.fraction, np.maximum(divisor, 1)
    quotient, remainder = scaled // by, scaled % by
    match rounding:
        case Rounding.FLOOR:
            up = np.zeros_like(quotient)
        case Rounding.HALF_UP:
            up = 2 * remainder >= by
        case Rounding.HALF_EVEN:
            up = (2 * remainder > by) | ((2 * remainder == by) & (quotient & 1 == 1))
        case Rounding.TOWARD_ZERO:
            up = (quotient < 0) & (remainder > 0)
    quotient = quotient + up
    outside = (quotient < FORM.lowest) | (quotient > FORM.highest) | (divisor == 0)
    limit = np.where(dividend < 0, FORM.lowest, FORM.highest)
    clamped = np.where(divisor == 0, limit, np.clip(quotient, FORM.lowest, FORM.highest))
    return clamped, outside


@pytest.mark.slow
@pytest.mark.parametrize("radix", [2, 4])
@pytest.mark.parametrize("rounding", Rounding)
def test_every_quotient_of_twelve_bits_is_the_defined_one(rounding, radix):
    dividend = Operand(form=Fixed(width=WIDTH, fraction=0), low=-(1 << WIDTH - 1), high=(1 << WIDTH - 1) - 1)
    divisor = Operand(form=Fixed(width=WIDTH, fraction=0, signed=False), low=0, high=(1 << WIDTH) - 1)
    core = LongDivider(dividend, divisor, FORM, rounding, radix)
    verilog = rtlil_to_verilog(to_rtlil(Divided(core), "divided"), "divided")
    mask = (1 << WIDTH) - 1
    divisors = np.arange(1 << WIDTH, dtype=np.int64)
    with Simulation(build_library(verilog, "divided", BORDER), BORDER) as simulation:
        for first in range(-(1 << WIDTH - 1), 1 << WIDTH - 1, 256):
            a, b = np.repeat(np.arange(first, first + 256), len(divisors)), np.tile(divisors, 256)
            tokens = np.stack([(a & mask).astype(np.uint64), b.astype(np.uint64)], axis=1)
            found = simulation.run(tokens, len(tokens)).outputs
            quotient, outside = defined(a, b, rounding)
            assert np.array_equal(found[:, 0], (quotient & mask).astype(np.uint64))
            assert np.array_equal(found[:, 1], outside.astype(np.uint64))
