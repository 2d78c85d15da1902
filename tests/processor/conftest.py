"""Cores of several word lengths, compiled once."""

import pytest

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.processor.core import PAPER_CORE, Core
from kalmanhdl.processor.rtl_simulation import RtlSimulation
from kalmanhdl.processor.verilog import core_verilog

CORES = {
    "paper": PAPER_CORE,
    "16 bits": Core(form=Fixed(width=16, fraction=9), rounding=Rounding.TOWARD_ZERO, matrices=32),
    "32 bits": Core(form=Fixed(width=32, fraction=24), overflow=Overflow.SATURATE, program_words=256),
}


@pytest.fixture(scope="session", params=CORES)
def core(request):
    return CORES[request.param]


@pytest.fixture(scope="session")
def verilog(core):
    return core_verilog(core)


@pytest.fixture
def rtl(core, verilog):
    with RtlSimulation(core, verilog) as simulation:
        yield simulation
