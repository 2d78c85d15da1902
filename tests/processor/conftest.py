"""Cores of several word lengths, compiled once."""

import pytest

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.graph.operations import Function
from kalmanhdl.processor.core import PAPER_CORE, Core
from kalmanhdl.processor.instructions import FUNCTIONS
from kalmanhdl.processor.rtl_simulation import RtlSimulation
from kalmanhdl.processor.verilog import core_verilog

CORES = {
    "paper": PAPER_CORE,
    "extended": Core(form=Fixed(width=16, fraction=9), matrices=64, program_words=256, extended=True),
    "2 by 2": Core(
        form=Fixed(width=12, fraction=12),
        rounding=Rounding.TOWARD_ZERO,
        overflow=Overflow.WRAP,
        size=2,
        extended=True,
    ),
    "functions": Core(
        form=Fixed(width=12, fraction=8),
        overflow=Overflow.WRAP,
        matrices=64,
        program_words=256,
        size=2,
        extended=True,
        functions=FUNCTIONS,
    ),
    "pipelined, functions": Core(
        form=Fixed(width=16, fraction=10),
        matrices=64,
        program_words=256,
        size=2,
        extended=True,
        units=2,
        functions=(Function.SINE, Function.COSINE, Function.SQUARE_ROOT, Function.EXPONENTIAL),
    ),
    "pipelined, N^2": Core(
        form=Fixed(width=16, fraction=9), matrices=64, program_words=256, extended=True, units=3
    ),
    "pipelined, N": Core(
        form=Fixed(width=12, fraction=12),
        rounding=Rounding.TOWARD_ZERO,
        overflow=Overflow.WRAP,
        matrices=16,
        size=2,
        extended=True,
        units=1,
    ),
    "floats": Core(
        form=Float(4, 5),
        matrices=64,
        program_words=256,
        size=2,
        extended=True,
        functions=(Function.SINE, Function.COSINE, Function.SQUARE_ROOT),
    ),
    "floats, pipelined": Core(
        form=Float(5, 8, subnormals=False), matrices=64, program_words=256, extended=True, units=1
    ),
}


@pytest.fixture(scope="session", params=CORES)
def core(request):
    return CORES[request.param]


@pytest.fixture(scope="session")
def verilog(core):
    return core_verilog(core)


@pytest.fixture
def rtl(core, verilog):
    with RtlSimulation(core, verilog, optimised=False) as simulation:
        yield simulation
