"""The Verilog of a core."""

from kalmanhdl import __version__
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.processor.core import Core, functions_of
from kalmanhdl.toolchain.yosys import rtlil_to_verilog

TOP = "controller"
"""The name of the top module."""


def _modes(core: Core) -> str:
    if isinstance(core.form, Fixed):
        return f"{core.rounding.value}, {core.overflow.value}"
    return f"{core.form.rounding.value}, {'with' if core.form.subnormals else 'without'} subnormals"


def core_verilog(core: Core) -> str:
    """The Verilog text of a core: the same for equal cores. Raises ToolError."""
    # Amaranth takes long to import; who only assembles does not need it.
    from kalmanhdl.processor.hardware.controller import Controller
    from kalmanhdl.processor.hardware.pipelined_controller import PipelinedController
    from kalmanhdl.rtl.verilog import to_rtlil

    header = (
        f"{TOP}: a programmable matrix processor made by kalmanhdl {__version__}\n"
        f"{core.size} by {core.size} matrices of {core.form}, {_modes(core)}; "
        f"{core.matrices} matrices, {core.program_words} words of program; "
        f"{'pipelined' if core.pipelined else 'eight clocks an instruction'}, "
        f"{core.multipliers} multipliers.\n"
    )
    if core.functions:
        header += f"Functions: {functions_of(core)}.\n"
    controller = PipelinedController(core) if core.pipelined else Controller(core)
    return rtlil_to_verilog(to_rtlil(controller, TOP), TOP, header)
