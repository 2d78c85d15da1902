"""What each operator costs: latency, area and clock, measured.

    python benchmarks/operators.py                    all of them, as a table in Markdown (half an hour)
    python benchmarks/operators.py --only divide      those whose line has the word
    python benchmarks/operators.py --list             what there is

Every operator stands alone between a row of registers before it and one behind it, which are counted. It is
synthesised, placed and routed out of context for ecp5-25k at grade 8 with one seed; the look-up tables of the
two other families are those of synthesis alone.
"""

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from amaranth.hdl import Module, Shape, UnusedElaboratable, signed
from amaranth.lib.wiring import Component, In, Out

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from function_graphs import alone
from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.division_structure import ONE, Operand
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.graph.operations import Constant, Flag, Function, Graph, Input, Multiply
from kalmanhdl.numerics.functions.method import Cordic, Interpolation
from kalmanhdl.numerics.quantise import quantise
from kalmanhdl.numerics.ranges import Ranges
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.rtl.datapath import Datapath
from kalmanhdl.rtl.divider import IterativeDivider, LongDivider
from kalmanhdl.rtl.interface import interface
from kalmanhdl.rtl.isolated import Between
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.reciprocal import TableNewtonReciprocal
from kalmanhdl.rtl.serial_multiplier import SerialMultiplier
from kalmanhdl.rtl.square_root import IterativeSquareRoot
from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.wanted import Wanted
from kalmanhdl.target import device
from kalmanhdl.toolchain.absorb import absorb_registers
from kalmanhdl.toolchain.area import area
from kalmanhdl.toolchain.nextpnr import place_and_route
from kalmanhdl.toolchain.yosys import rtlil_to_verilog, synthesise_ecp5

PART = device("ecp5-25k", 8)
CLOCK_MHZ = 250.0
HEADING = "| operator | width | latency | LUT4s | FFs | DSPs | MHz | ns | xc4v LUTs | lut4 LUTs |"


@dataclass(frozen=True)
class Operator:
    """An operator: clocks from operands to result, clocks between two of its operands, and how it is made."""

    name: str
    width: str
    latency: int
    busy: int
    make: Callable[[], Component]


class Adder(Component):
    """A sum of two signed numbers."""

    def __init__(self, width: int) -> None:
        super().__init__({"a": In(signed(width)), "b": In(signed(width)), "y": Out(signed(width))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += self.y.eq(self.a + self.b)
        return m


class Quantiser(Component):
    """A number brought to half its width."""

    def __init__(self, width: int, rounding: Rounding) -> None:
        self.form, self.rounding, self.width = Fixed(width=width // 2, fraction=0), rounding, width
        super().__init__({"a": In(signed(width)), "y": Out(signed(width // 2))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        value, _ = quantised(self.a, self.width // 4, self.form, self.rounding, Overflow.SATURATE)
        m.d.comb += self.y.eq(value)
        return m


def sums() -> Iterator[Operator]:
    for width in (16, 18, 32):
        yield Operator("add", f"{width}", 0, 1, lambda width=width: Adder(width))
    for rounding in (Rounding.HALF_UP, Rounding.HALF_EVEN):
        made = lambda rounding=rounding: Quantiser(32, rounding)  # noqa: E731
        yield Operator(f"quantise, {rounding.value}, saturating", "32 to 16", 0, 1, made)


def products() -> Iterator[Operator]:
    kinds = {
        "DSP blocks": (True, LogicProduct.BOOTH),
        "Booth": (False, LogicProduct.BOOTH),
        "Wallace": (False, LogicProduct.WALLACE),
    }
    for (p, q), depths in (((17, 8), (0, 2)), ((16, 16), (0, 3)), ((32, 32), (4,))):
        for kind, (on_block, logic) in kinds.items():
            for depth in depths:
                shapes = Shape(p, True), Shape(q, True)
                made = lambda s=shapes, d=depth, b=on_block, k=logic: Multiplier(*s, d, b, k)  # noqa: E731
                yield Operator(f"multiply, {kind}", f"{p} x {q}", depth, 1, made)
    serial = SerialMultiplier(Shape(16, True), Shape(16, True))
    yield Operator("multiply, shift and add", "16 x 16", serial.latency, serial.latency, lambda: serial)
    typed = constant_product(Fraction(0x5A3D, 1 << 14))
    yield from graph("multiply by 0x5A3D, shifts and adds", "16", typed)


def divisions() -> Iterator[Operator]:
    for name, width, dividend, divisor, form in (
        ("divide", "17 by 17 to 8", _all(17, 0, True), _all(17, 0, False), Fixed(width=8, fraction=6)),
        ("divide", "16 by 16 to 16", _all(16, 0, True), _all(16, 0, False), Fixed(width=16, fraction=12)),
        ("reciprocal", "16 to 16", ONE, _all(16, 8, False), Fixed(width=16, fraction=12)),
    ):
        for radix in (2, 4):
            kinds = (dividend, divisor, form, Rounding.HALF_UP, radix)
            for depth in (0, len(LongDivider(*kinds).structure.row_bits) + 1):
                made = lambda k=kinds, d=depth: LongDivider(*k, d)  # noqa: E731
                yield Operator(f"{name}, array, radix {radix}", width, depth, 1, made)
            one = IterativeDivider(*kinds, 1)
            made = lambda one=one: one  # noqa: E731
            yield Operator(f"{name}, one row, radix {radix}", width, one.latency, one.latency, made)
    kinds = _all(16, 8, False), Fixed(width=16, fraction=12), Rounding.HALF_UP
    for method in (TableNewton(index_bits=7, iterations=0), TableNewton(index_bits=7, iterations=1)):
        for depth in (0, 2 + 4 * method.iterations):
            made = lambda m=method, d=depth: TableNewtonReciprocal(*kinds, m, d)  # noqa: E731
            what = f"reciprocal, table of 128, {method.iterations} Newton"
            yield Operator(what, "16 to 16", depth, 1, made)


def functions() -> Iterator[Operator]:
    one = IterativeSquareRoot(16, 8)
    yield Operator("square root, one row", "16 to 16", one.latency, one.latency, lambda: one)
    unit, angle = Fixed(width=16, fraction=14), Fixed(width=16, fraction=16)
    wide = Fixed(width=16, fraction=8)
    for function, arguments, result in (
        (Function.SQUARE_ROOT, (Fixed(width=16, fraction=8, signed=False),), Fixed(width=16, fraction=12)),
        (Function.SINE, (angle,), unit),
        (Function.ARCTANGENT, (wide, wide), angle),
        (Function.HYPOTENUSE, (wide, wide), wide),
        (Function.EXPONENTIAL, (Fixed(width=16, fraction=13),), Fixed(width=16, fraction=9)),
    ):
        for method in (Cordic(), Interpolation(index_bits=8)):
            if function in (Function.SQUARE_ROOT, Function.ARCTANGENT) and method != Cordic():
                continue
            how = {Function.SQUARE_ROOT: "rows"}.get(function, type(method).__name__)
            typed = alone(function, arguments, result, method)
            yield from graph(f"{function.value}, {how}", "16 to 16", typed)


def graph(name: str, width: str, typed: TypedGraph) -> Iterator[Operator]:
    """What is made of exact operations, with the registers that a schedule for a fast clock gives it."""
    clocks = (Wanted(interval=1, channels=2, clock_mhz=clock) for clock in (1.0, None))
    plans = {plan.latency: plan for plan in (schedule(typed, PART, wanted) for wanted in clocks)}
    for plan in plans.values():
        made = lambda plan=plan: Datapath(plan, interface(plan))  # noqa: E731
        yield Operator(name, width, plan.latency - 1, 1, made)


def constant_product(factor: Fraction) -> TypedGraph:
    operations = (Flag("initialise"), Input("z[0]"), Constant(factor), Multiply(1, 2))
    found = Graph(operations, ("", "measurement: z[0]", "", "predict: f[0]"), (), (("f[0]", 3),))
    given = {"z[0]": Fixed(width=16, fraction=8), "f[0]": Fixed(width=32, fraction=22)}
    ends = (0.0,) * 4, (1.0,) * 4
    return quantise(found, Ranges(low=ends[0], high=ends[1]), FixedSpecification(signals=given), {})


def _all(width: int, fraction: int, is_signed: bool) -> Operand:
    form = Fixed(width=width, fraction=fraction, signed=is_signed)
    return Operand(form=form, low=form.lowest, high=form.highest)


def operators() -> list[Operator]:
    return [*sums(), *products(), *divisions(), *functions()]


def line(operator: Operator) -> str:
    """A row of the table."""
    verilog = rtlil_to_verilog(to_rtlil(Between(operator.make()), "operator"), "operator")
    netlist = absorb_registers(synthesise_ecp5(verilog, "operator"))
    [placed] = place_and_route(netlist, PART, (1,), CLOCK_MHZ)
    luts = [area(verilog, "operator", family).luts for family in ("xc4v", "lut4")]
    busy = f", busy {operator.busy}" if operator.busy > 1 else ""
    # From the registers before to those behind: one stage more than there are registers inside.
    nanoseconds = (operator.latency + 1) * 1000 / placed.fmax_mhz
    cells = (
        operator.name,
        operator.width,
        f"{operator.latency}{busy}",
        placed.luts,
        placed.ffs,
        placed.multipliers,
        f"{placed.fmax_mhz:.0f}",
        f"{nanoseconds:.1f}",
        *luts,
    )
    return f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="operators whose line has this word")
    parser.add_argument("--list", action="store_true", help="say what there is, and measure nothing")
    options = parser.parse_args()
    # Some are made only to be asked how long they take.
    warnings.simplefilter("ignore", UnusedElaboratable)
    chosen = [o for o in operators() if options.only in f"{o.name} {o.width}"]
    if options.list:
        print("\n".join(f"{o.name}, {o.width}, latency {o.latency}" for o in chosen))
        return
    print(HEADING)
    print("|---|---|---|---|---|---|---|---|---|---|")
    for operator in chosen:
        print(line(operator), flush=True)


if __name__ == "__main__":
    main()
