"""The hardware of lee1997, part by part: table 1 and section 5.3.

Lee & Salcic, High-performance FPGA-based implementation of Kalman filter, 1997: nine chips of 4-input look-up
tables, with Wallace multipliers and array dividers.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kalmanhdl.arithmetic.division_structure import Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.lee1997_parts import parts, sum_of
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.wanted import Wanted
from kalmanhdl.target import device
from kalmanhdl.toolchain.area import area
from kalmanhdl.toolchain.nextpnr import best, place_and_route
from kalmanhdl.toolchain.yosys import rtlil_to_verilog, synthesise_ecp5

if TYPE_CHECKING:
    from kalmanhdl.rtl.datapath import Datapath

# So slow a clock that nothing is pipelined.
_NO_PIPELINE_MHZ = 1.0
_CLOCK_MHZ = 250.0
_SEEDS = (1, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Speed:
    """An operator alone on ecp5-25k at grade 8: nanoseconds from register to register, and cells."""

    nanoseconds: float
    luts: int
    multipliers: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """4-input look-up tables of each part by kind of multiplier, and the speeds of operators by name."""

    luts: dict[LogicProduct, dict[str, int]]
    speeds: dict[str, Speed]


def part_luts(name: str, product: LogicProduct) -> int:
    """The 4-input look-up tables of a part, carry chains of one a bit among them, after synthesis."""
    from kalmanhdl.rtl.verilog import to_rtlil

    core = _combinational(parts(product)[name])
    return area(rtlil_to_verilog(to_rtlil(core, "part"), "part"), "part", "lut4").luts


def _combinational(typed: TypedGraph) -> "Datapath":
    """The hardware of a graph in one stage, without multiplier blocks."""
    from kalmanhdl.rtl.datapath import Datapath
    from kalmanhdl.rtl.interface import interface

    part = device("ecp5-25k", 8)
    plan = schedule(
        typed, part, Wanted(interval=1, channels=1, clock_mhz=_NO_PIPELINE_MHZ, multiplier_blocks=0)
    )
    return Datapath(plan, interface(plan))


def speeds(progress: Progress = silent) -> dict[str, Speed]:
    """The operators of section 5.3, each alone between registers, placed and routed."""
    from kalmanhdl.rtl.divider import LongDivider
    from kalmanhdl.rtl.isolated import Between
    from kalmanhdl.rtl.multiplier import Multiplier
    from kalmanhdl.rtl.shapes import shape_of
    from kalmanhdl.rtl.verilog import to_rtlil

    wide, gain = shape_of(Fixed(width=17, fraction=0)), shape_of(Fixed(width=8, fraction=8))
    operand = Operand(form=Fixed(width=17, fraction=0, signed=False), low=0, high=(1 << 17) - 1)
    quotient = Fixed(width=8, fraction=8, signed=False)
    cores = {
        "adder 18": _combinational(sum_of(18)),
        "multiplier 17 by 8, Wallace": Multiplier(wide, gain, 0, False, LogicProduct.WALLACE),
        "multiplier 17 by 8, Booth": Multiplier(wide, gain, 0, False, LogicProduct.BOOTH),
        "multiplier 17 by 8, DSP block": Multiplier(wide, gain),
        "divider 17 by 17 to 8, radix 2": LongDivider(operand, operand, quotient, Rounding.FLOOR, 2),
        "divider 17 by 17 to 8, radix 4": LongDivider(operand, operand, quotient, Rounding.FLOOR, 4),
    }
    found = {}
    for name, core in cores.items():
        progress(f"placing and routing: {name}")
        verilog = rtlil_to_verilog(to_rtlil(Between(core), "operator"), "operator")
        netlist = synthesise_ecp5(verilog, "operator")
        placed = best(place_and_route(netlist, device("ecp5-25k", 8), _SEEDS, _CLOCK_MHZ))
        found[name] = Speed(
            nanoseconds=1000 / placed.fmax_mhz, luts=placed.luts, multipliers=placed.multipliers
        )
    return found


def figures(progress: Progress = silent) -> Figures:
    """Table 1 and section 5.3, measured."""
    luts: dict[LogicProduct, dict[str, int]] = {}
    for product in (LogicProduct.WALLACE, LogicProduct.BOOTH):
        luts[product] = {}
        for name in facts("lee1997")["cells"]:
            progress(f"synthesising part {name}, {product.value}")
            luts[product][name] = part_luts(name, product)
    return Figures(luts=luts, speeds=speeds(progress))


def reproduction(found: Figures) -> Reproduction:
    """The paper's logic cells and delays beside those of kalmanhdl's operators."""
    data = facts("lee1997")
    kinds = (LogicProduct.WALLACE, LogicProduct.BOOTH)
    rows = [
        (f"{name}, cells", str(cells), *(str(found.luts[kind][name]) for kind in kinds))
        for name, cells in data["cells"].items()
    ]
    totals = (sum(found.luts[kind].values()) for kind in kinds)
    rows.append(("all parts, cells", str(sum(data["cells"].values())), *map(str, totals)))
    for name, speed in found.speeds.items():
        printed = data["nanoseconds"][name.split()[0]]
        cost = f"{speed.luts} LUTs" + (f", {speed.multipliers} DSP" if speed.multipliers else "")
        rows.append((f"{name}, ns", f"{printed:g}", f"{speed.nanoseconds:.1f}", cost))
    return Reproduction(
        title="Lee & Salcic 1997: table 1 part by part, and the operators of section 5.3",
        columns=("", "paper", "kalmanhdl", "with Booth; of an operator, its cost"),
        rows=tuple(rows),
        notes=_notes(data["chosen"]),
        charts={},
    )


def _notes(chosen: dict[str, int]) -> tuple[str, ...]:
    return (
        "Cells of the paper are FLEX 8000 logic elements: a 4-input look-up table, a carry and a register. "
        "Ours are 4-input look-up tables after synthesis, one a bit of a carry chain among them; a part's "
        "registers would stand in the same elements.",
        "What a part holds is not said: A predicts and divides, B and C update with one gain each, as their "
        "sizes tell. Equations (14) to (19) as written: of the covariance's symmetry nothing is used.",
        f"Not said either: predicted covariances of {chosen['range_predicted']} bits in range and "
        f"{chosen['bearing_predicted']} in bearing, innovations of {chosen['innovation']}.",
        "Nanoseconds of ours are from register to register on ecp5-25k, grade 8, placed and routed; the "
        "paper's are of a device of its time, so that these compare years, not designs.",
    )
