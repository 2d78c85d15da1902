"""The experiment of bhatia2012: appendix A's filter of a constant, on the paper's own processor.

Bhatia, A Kalman Filter Controller on an FPGA, 2012. The paper runs appendix A in MATLAB; here the seven
steps of section 3.3 run as a program of its eleven instructions. The set has neither subtraction nor inverse:
a sign is changed by MULT_3S, and the inverse of M is refined from that of the step before by
X <- X (2 I - M X), which squares its error.

The filter's covariances are divided by 0.01 as they go in, so that 1/M and P fit one format.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.core import PAPER_CORE, Core
from kalmanhdl.processor.peripherals import HandshakingSink, HandshakingSource
from kalmanhdl.processor.program import Program
from kalmanhdl.processor.rtl_simulation import Peripherals, RtlSimulation
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.processor.verification import compare
from kalmanhdl.processor.verilog import TOP, core_verilog
from kalmanhdl.report.chart import Chart, Line, Panel, Style
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.target import device
from kalmanhdl.toolchain.absorb import absorb_registers
from kalmanhdl.toolchain.area import AreaFigures, area
from kalmanhdl.toolchain.nextpnr import Implementation, best, place_and_route
from kalmanhdl.toolchain.yosys import synthesise_ecp5

Array = NDArray[np.float64]

CORE = Core(form=Fixed(width=32, fraction=24))
UNIT = 0.01
"""What the covariances are divided by: then P begins at 100, and 1/M ends below 100."""

REFINEMENTS = 18
"""Squarings of the inverse's error. At most it begins at 1 - 1/5000, the leap of M in the second step."""

FIRST_INVERSE = 2.0**-7
DEVICE, GRADE, SEEDS, CLOCK_MHZ = "ecp5-85k", 8, 2, 200.0
LATENCIES = (0, 13, 90, 5)
"""Clocks that either peripheral takes, in turn."""

_LOADED = ("A", "At", "Q", "H", "Ht", "R", "ID", "TWO", "NEG", "X", "P", "XI")
_COMPUTED = ("XP", "PP", "ZP", "M", "NM", "Z", "N", "V1", "K", "T1", "T2")
_STEPS = """
    MULT_31   A    X    XP    -- 1. state prediction
    MULT_33   A    P    T1    -- 2. its error
    MULT_33   T1   At   T2
    ADD_33    T2   Q    PP
    MULT_31   H    XP   ZP    -- 3. the measurement's prediction
    MULT_33   H    PP   T1    -- 4. its error
    MULT_33   T1   Ht   T2
    ADD_33    T2   R    M
    MULT_3S   ZP   NEG  V1    -- 5. innovation
    ADD_33    Z    V1   N
    MULT_3S   M    NEG  NM    -- 6. gain
"""
_REFINEMENT = """
    MULT_33   NM   XI   T1
    ADD_33    T1   TWO  T1
    MULT_33   XI   T1   XI
"""
_UPDATE = """
    MULT_33   PP   Ht   T1
    MULT_33   T1   XI   K
    MULT_31   K    N    V1    -- 7. updates
    ADD_33    XP   V1   X
    MULT_33   K    H    T1
    MULT_3S   T1   NEG  T1
    ADD_33    ID   T1   T1
    MULT_33   T1   PP   P
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Filtering:
    """Estimate, covariance and gain, in columns, after all measurements but the first, as appendix A.

    ``exact`` as the processor puts them out, ``reference`` in double precision. ``compared``: values of the
    simulator and of the Verilog that were compared, all of them equal.
    """

    exact: Array
    reference: Array
    clocks: int
    instructions: int
    saturated: bool
    compared: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Figures:
    """Both runs, the program, and the paper's own core of 8 bits after synthesis, and placed and routed."""

    right: Filtering
    wrong: Filtering
    program: Program
    synthesis: AreaFigures
    implementation: Implementation


def source() -> str:
    """The program: reads the matrices, then a measurement a turn; puts out x, P and K."""
    loads = chain.from_iterable(_read(name, element) for name in _LOADED for element in range(CORE.elements))
    turn = [*_read("Z", 0), *_STEPS.splitlines(), *_REFINEMENT.splitlines() * REFINEMENTS]
    turn += [*_UPDATE.splitlines(), *chain.from_iterable(map(_write, "XPK"))]
    data = [".data", *(f"{name}:" for name in (*_LOADED, *_COMPUTED))]
    return "\n".join([".text", *loads, "TURN:", *turn, "    JUMP_U TURN", *data]) + "\n"


def _read(name: str, element: int) -> Iterator[str]:
    here = f"{name}{element}_in"
    yield f"{here}: JUMP_DRDY {here}"
    yield f"    READ      {element}    {name}"


def _write(name: str) -> Iterator[str]:
    yield f"{name}_out: JUMP_ACK {name}_out"
    yield f"    WRITE     {name}    0"


def tokens(R: float) -> tuple[int, ...]:
    """What the program reads: its matrices row after row, then the measurements but the first."""
    data = facts("bhatia2012")
    eye = np.eye(CORE.size)

    def scalar(value: float, others: float = 0.0) -> Array:
        return np.diag([value, *[others] * (CORE.size - 1)])

    A, H = scalar(data["A"], 1.0), scalar(data["H"])
    matrices = (
        *(A, A.T, scalar(data["Q"] / UNIT), H, H.T, scalar(R / UNIT, 1.0)),
        *(eye, 2 * eye, scalar(-1.0), scalar(data["x0"]), scalar(data["P0"] / UNIT)),
        scalar(FIRST_INVERSE, 1.0),
    )
    numbers = [*np.ravel(matrices), *data["zk"][1:]]
    return tuple(CORE.form.nearest(float(number)) for number in numbers)


def by_hand(R: float) -> Array:
    """Appendix A in double precision: x, P and K in columns."""
    data = facts("bhatia2012")
    x, P, rows = data["x0"], data["P0"], []
    for z in data["zk"][1:]:
        x, P = data["A"] * x, data["A"] * P * data["A"] + data["Q"]
        K = P / (P + R)
        x, P = x + K * (z - x), (1 - K) * P
        rows.append((x, P, K))
    return np.array(rows)


def filtering(program: Program, rtl: RtlSimulation, R: float) -> Filtering:
    """The program on the simulator, and again beside the Verilog, with peripherals that take their time."""
    given = tokens(R)
    latencies = [LATENCIES[k % len(LATENCIES)] for k in range(len(given))]
    reactions = [k % 4 for k in range(len(given))]
    peripherals = Peripherals(
        tokens=given,
        latencies=latencies,
        reactions=reactions,
        sink_latencies=LATENCIES,
        sink_reactions=range(len(LATENCIES)),
    )
    machine = Machine(
        CORE,
        HandshakingSource(given, latencies, reactions),
        HandshakingSink(LATENCIES, range(len(LATENCIES))),
    )
    machine.load(program.words)
    done = run(machine, 1_000_000)
    saturated, clocks = machine.saturated, machine.clock
    fresh = Machine(CORE, machine.source, machine.sink)
    compared = compare(CORE, rtl, fresh, program.words, peripherals, done.instructions)
    sent = np.array([float(CORE.form.real(raw)) for raw in done.sent]).reshape(-1, 3)
    return Filtering(
        exact=sent * [1.0, UNIT, 1.0],
        reference=by_hand(R),
        clocks=clocks,
        instructions=done.instructions,
        saturated=saturated,
        compared=compared,
    )


def figures(progress: Progress = silent) -> Figures:
    """Both runs, on simulator and Verilog, and the paper's core through synthesis, place and route."""
    data = facts("bhatia2012")
    program = assemble(source(), CORE)
    progress("compiling the Verilog of a core of 32 bits")
    verilog = core_verilog(CORE)
    runs = []
    for R in (data["R"], data["R_wrong"]):
        with RtlSimulation(CORE, verilog, optimised=False) as rtl:
            progress(f"appendix A with R = {R:g}, on simulator and Verilog")
            runs.append(filtering(program, rtl, R))
    progress("synthesising the paper's core of 8 bits for its device")
    own = core_verilog(PAPER_CORE)
    synthesis = area(own, TOP, "xc6v")
    progress(f"placing and routing it on {DEVICE}")
    netlist = absorb_registers(synthesise_ecp5(own, TOP))
    placed = place_and_route(netlist, device(DEVICE, GRADE), range(1, SEEDS + 1), CLOCK_MHZ)
    return Figures(
        right=runs[0], wrong=runs[1], program=program, synthesis=synthesis, implementation=best(placed)
    )


def reproduction(found: Figures) -> Reproduction:
    """The two runs beside double precision, and the core beside the paper's."""
    both = (found.right, found.wrong)
    data = facts("bhatia2012")
    settled = data["settled_after"] - 2
    rows = [
        _row("estimate at iteration 10", "near -0.25", (_pair(r, 0, ".6f", settled) for r in both)),
        _row("estimate at iteration 50", "", (_pair(r, 0, ".6f") for r in both)),
        _row("covariance at iteration 50", "", (_pair(r, 1, ".4e") for r in both)),
        _row("gain at iteration 50", "", (_pair(r, 2, ".6f") for r in both)),
        _row(
            "error of the estimate, rms", "", (f"{_rms(r.exact):.4f} {_rms(r.reference):.4f}" for r in both)
        ),
        _row(
            "the same, moving average of 3", "", (f"{_rms(moving_average()[1:-1, None]):.4f}" for _ in both)
        ),
        _row("estimate at most off double", "", (f"{_off(r):.1e}" for r in both)),
        _row("results that did not fit", "", ("some" if r.saturated else "none" for r in both)),
        _row("simulator = Verilog, values", "", (f"{r.compared}, 0 differ" for r in both)),
        _row("instructions, clocks", "", (f"{r.instructions}, {r.clocks}" for r in both)),
    ]
    return Reproduction(
        title="Bhatia 2012: a constant, filtered on the programmable processor",
        columns=("processor, then double precision", "paper", "R = 0.01", "R = 0.0001"),
        rows=(*rows, *_hardware_rows(found)),
        notes=_notes(found),
        charts=_charts(found),
    )


def _row(what: str, paper: str, values: Iterable[str]) -> tuple[str, ...]:
    return (what, paper, *values)


def _pair(found: Filtering, column: int, form: str, at: int = -1) -> str:
    return f"{found.exact[at, column]:{form}} {found.reference[at, column]:{form}}"


def _off(found: Filtering) -> float:
    return float(np.abs(found.exact[:, 0] - found.reference[:, 0]).max())


def _hardware_rows(found: Figures) -> Iterator[tuple[str, ...]]:
    paper, here, placed = facts("bhatia2012")["hardware"], found.synthesis, found.implementation
    yield (
        "the paper's core of 8 bits",
        paper["device"],
        "xc6v, synthesis",
        f"{placed.device}, grade {placed.grade}",
    )
    for what, figure, own, other in (
        ("registers", paper["slice_registers"], here.ffs, placed.ffs),
        ("look-up tables", paper["slice_luts"], here.luts, placed.luts),
        ("multiplier blocks", paper["dsp48e1"], here.multipliers, placed.multipliers),
        ("block RAMs", paper["ramb16"], here.block_rams, placed.block_rams),
    ):
        yield (what, str(figure), str(own), str(other))
    yield ("clock, MHz", "", "", f"{placed.fmax_mhz:.1f} (seed {placed.seed} of {SEEDS})")


def _notes(found: Figures) -> tuple[str, ...]:
    return (
        f"The program has {len(found.program.words)} words of 512 and runs on {CORE.form}; covariances "
        f"are in units of {UNIT:g}.",
        f"The paper's set has no inverse: {REFINEMENTS} refinements of three instructions a turn make it.",
        "As appendix A has it, the first measurement is not used, and iteration k is after measurement k.",
        f"The peripherals take {', '.join(map(str, LATENCIES))} clocks in turn, whatever the processor does.",
        "The paper's 637.8 MHz is synthesis's estimate between two registers; to its outputs 13.2 ns.",
    )


def moving_average() -> Array:
    """The mean of every measurement and its two neighbours, with a zero behind the last, as appendix A."""
    z = np.array([*facts("bhatia2012")["zk"], 0.0])
    found = np.zeros(len(z) - 1)
    found[1:] = (z[:-2] + z[1:-1] + z[2:]) / 3
    return found


def _rms(columns: Array) -> float:
    """Of the first column, about the true value."""
    return float(np.sqrt(np.mean((columns[:, 0] - facts("bhatia2012")["true_value"]) ** 2)))


def _charts(found: Figures) -> dict[str, Chart]:
    return {
        "figure_22_estimate": _estimate("figure 22: estimate, R = 0.01", found.right),
        "figure_23_covariance": _of("figure 23: covariance", "covariance", found.right, 1),
        "figure_24_gain": _of("figure 24: Kalman gain", "gain", found.right, 2),
        "figure_25_wrong_R": _estimate("figure 25: estimate, R = 0.0001", found.wrong),
    }


def _estimate(title: str, run_: Filtering) -> Chart:
    data = facts("bhatia2012")
    z = np.array(data["zk"])
    n = np.arange(1.0, 1 + len(z))
    first = [data["x0"]]
    lines = (
        Line(label="estimate, processor", x=n, y=np.concatenate([first, run_.exact[:, 0]]), color=0),
        Line(
            label="estimate, double",
            x=n,
            y=np.concatenate([first, run_.reference[:, 0]]),
            color=1,
            style=Style.DASHED,
        ),
        Line(label="measurement", x=n, y=z, color=2, style=Style.DOTS),
        Line(label="moving average of 3", x=n, y=moving_average(), color=3),
        Line(label="true value", x=n, y=np.full(len(z), data["true_value"]), color=4),
    )
    return Chart(title=f"bhatia2012, {title}", label="iteration", panels=(Panel(label="unit", lines=lines),))


def _of(title: str, label: str, run_: Filtering, column: int) -> Chart:
    n = np.arange(2.0, 2 + len(run_.exact))
    lines = (
        Line(label="processor", x=n, y=run_.exact[:, column], color=0, style=Style.MARKED),
        Line(label="double precision", x=n, y=run_.reference[:, column], color=1, style=Style.DASHED),
    )
    return Chart(title=f"bhatia2012, {title}", label="iteration", panels=(Panel(label=label, lines=lines),))
