"""A design with a processor, the whole line down: program, core, test bench, verification, figures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from kalmanhdl.processor.checks import Checked, drawn_rows, verified
from kalmanhdl.processor.compiler.folder import contents
from kalmanhdl.processor.fit import Fitted
from kalmanhdl.processor.follow import Followed, follow, rows_of
from kalmanhdl.processor.step import Step, step_of
from kalmanhdl.processor.verilog import TOP
from kalmanhdl.simulate.data import Plots
from kalmanhdl.target import device
from kalmanhdl.toolchain.nextpnr import Implementation
from kalmanhdl.toolchain.stages import timed


@dataclass(frozen=True, slots=True, kw_only=True)
class Built:
    """What a build made: files by name, figures, and the seconds that it took; a stage left out has none.

    The best of the placements comes first.
    """

    fit: Fitted
    files: Mapping[str, str]
    step: Step
    followed: Followed | None = None
    checked: tuple[Checked, ...] = ()
    placed: tuple[Implementation, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)


def build(
    fit: Fitted,
    plots: Plots | None,
    *,
    steps: int,
    place: bool,
    progress: Callable[[str], None],
) -> Built:
    """Everything of a design's program.

    ``plots`` are filtered; the test bench is of the track with most rows of them, or of a track drawn from
    the model. ``steps`` rows, of the plots and then of tracks drawn from the model, are held against the
    Verilog; 0 leaves that out. ``place``: also synthesis, place and route. Raises ToolError,
    VerificationError.
    """
    seconds: dict[str, float] = {}
    drawn = drawn_rows(fit, max(steps, 1))
    data = () if plots is None else rows_of(fit.core, fit.given, fit.scaling, plots)
    with timed(seconds, "rtl", progress, "writing program and Verilog"):
        files = dict(contents(fit.filter_, fit.core, max(data, key=len) if any(data) else drawn[0]))
    followed = None
    if plots is not None:
        with timed(seconds, "simulate", progress, "filtering the data in floats and in the core's numbers"):
            followed = follow(fit.filter_, fit.core, fit.given, fit.design.algorithm, fit.scaling, plots)
    checked: tuple[Checked, ...] = ()
    if steps:
        message = f"verifying {steps} steps: engine, instruction-set simulator, Verilog"
        with timed(seconds, "verify", progress, message):
            checked = verified(fit, files["core.v"], [rows for rows in data if rows], drawn, steps)
    placed: tuple[Implementation, ...] = ()
    if place:
        with timed(seconds, "place_and_route", progress, "synthesising, placing and routing"):
            placed = implemented(fit, files["core.v"])
    return Built(
        fit=fit,
        files=files,
        step=step_of(fit),
        followed=followed,
        checked=checked,
        placed=placed,
        seconds=seconds,
    )


def implemented(fit: Fitted, verilog: str) -> tuple[Implementation, ...]:
    """The core placed and routed for the design's target, the best placement first. Raises ToolError."""
    from kalmanhdl.toolchain.absorb import absorb_registers
    from kalmanhdl.toolchain.nextpnr import best, place_and_route
    from kalmanhdl.toolchain.yosys import synthesise_ecp5

    target = fit.design.target
    part = device(target.device, target.grade)
    netlist = absorb_registers(synthesise_ecp5(verilog, TOP))
    wanted = 1000 / part.pipelined_period_ns
    found = place_and_route(netlist, part, range(1, target.seeds + 1), wanted)
    first = best(found)
    return (first, *(one for one in found if one is not first))
