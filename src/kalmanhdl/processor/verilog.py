"""The Verilog of a core."""

from kalmanhdl import __version__
from kalmanhdl.processor.core import Core
from kalmanhdl.toolchain.yosys import rtlil_to_verilog

TOP = "controller"
"""The name of the top module."""


def core_verilog(core: Core) -> str:
    """The Verilog text of a core: the same for equal cores. Raises ToolError."""
    # Amaranth takes long to import; who only assembles does not need it.
    from kalmanhdl.processor.hardware.controller import Controller
    from kalmanhdl.rtl.verilog import to_rtlil

    header = (
        f"{TOP}: a programmable matrix processor made by kalmanhdl {__version__}\n"
        f"{core.size} by {core.size} matrices of {core.form}, {core.rounding.value}, {core.overflow.value}; "
        f"{core.matrices} matrices, {core.program_words} words of program.\n"
    )
    return rtlil_to_verilog(to_rtlil(Controller(core), TOP), TOP, header)
