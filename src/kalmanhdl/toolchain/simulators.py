"""The simulators that verification can run the Verilog in."""

from enum import StrEnum
from typing import assert_never

from kalmanhdl.toolchain import cxxrtl, icarus, verilator
from kalmanhdl.toolchain.harness import Border
from kalmanhdl.toolchain.simulation import Compiled, Simulate


class Simulator(StrEnum):
    """A simulator by its name in reports."""

    CXXRTL = "cxxrtl"
    VERILATOR = "verilator"
    ICARUS = "icarus"


def simulate_with(
    simulator: Simulator, verilog: str, top: str, border: Border, *, optimised: bool
) -> Simulate:
    """A design made ready for a simulator.

    Not ``optimised`` it is ready sooner and simulates slower, where there is the choice. Raises ToolError
    where the simulator or a compiler is missing.
    """
    match simulator:
        case Simulator.CXXRTL:
            library = cxxrtl.build_library(verilog, top, border, optimised=optimised)
        case Simulator.VERILATOR:
            library = verilator.build_library(verilog, top, border, optimised=optimised)
        case Simulator.ICARUS:
            return icarus.Icarus(program=icarus.compile_bench(verilog, top, border))
        case _:
            assert_never(simulator)
    return Compiled(name=simulator.value, library=library)


def need(simulators: tuple[Simulator, ...]) -> None:
    """Raise ToolError where the system lacks one of them."""
    if Simulator.VERILATOR in simulators:
        verilator.verilator()
    if Simulator.ICARUS in simulators:
        icarus.iverilog()
