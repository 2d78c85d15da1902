"""Measure floating-point operators on ecp5-25k, grade 8: LUTs, multipliers, registers, and the clock.

    python benchmarks/float_operators.py                 single precision, at some latencies
    python benchmarks/float_operators.py --format 5 10   another format
    python benchmarks/float_operators.py --only add      one operator

A latency counts the registers from those that hold the operands to the one that holds the result, that one
included. LUTs are those that nextpnr places, two of them for each piece of carry chain.
"""

import argparse

from amaranth.hdl import Module, Signal
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.rtl.floating.adder import FloatAdder
from kalmanhdl.rtl.floating.divider import FloatDivider
from kalmanhdl.rtl.floating.fused import FloatFused
from kalmanhdl.rtl.floating.multiplier import FloatMultiplier
from kalmanhdl.rtl.floating.scaler import FloatScaler
from kalmanhdl.rtl.floating.square_root import FloatSquareRoot
from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.target import device
from kalmanhdl.toolchain.absorb import absorb_registers
from kalmanhdl.toolchain.nextpnr import best, place_and_route
from kalmanhdl.toolchain.yosys import rtlil_to_verilog, synthesise_ecp5

OPERATORS = {
    "add": (lambda form, registers: FloatAdder(form, registers), (3, 7, 10)),
    "multiply": (lambda form, registers: FloatMultiplier(form, registers), (3, 5, 8)),
    "multiply in logic": (lambda form, registers: FloatMultiplier(form, registers, False), (5, 8)),
    "fused": (lambda form, registers: FloatFused(form, registers), (8, 12)),
    "divide": (lambda form, registers: FloatDivider(form, registers), (14, 28)),
    "reciprocal": (lambda form, registers: FloatDivider(form, registers, reciprocal=True), (14, 28)),
    "square root": (lambda form, registers: FloatSquareRoot(form, registers), (14, 28)),
    "scale by 1/4": (lambda form, registers: FloatScaler(form, -2, registers), (3,)),
}


class BetweenRegisters(Component):
    """An operator whose operands come from registers and whose result goes into one."""

    def __init__(self, core: Component) -> None:
        self._core = core
        self._operands = [name for name in ("a", "b", "c") if hasattr(core, name)]
        ports = {name: In(len(getattr(core, name))) for name in self._operands}
        super().__init__(ports | {"result": Out(len(core.result))})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.submodules.core = self._core
        for name in self._operands:
            held = Signal(len(getattr(self, name)), name=f"{name}_held", reset_less=True)
            m.d.sync += held.eq(getattr(self, name))
            m.d.comb += getattr(self._core, name).eq(held)
        result = Signal(len(self.result), name="result_held", reset_less=True)
        m.d.sync += result.eq(self._core.result)
        m.d.comb += self.result.eq(result)
        return m


def measured(core: Component, seeds: int) -> str:
    part = device("ecp5-25k", 8)
    verilog = rtlil_to_verilog(to_rtlil(BetweenRegisters(core), "top"), "top")
    netlist = absorb_registers(synthesise_ecp5(verilog, "top"))
    one = best(place_and_route(netlist, part, range(1, seeds + 1), 250.0, jobs=1))
    lut4, carry = (netlist.cells.get(kind, 0) for kind in ("LUT4", "CCU2C"))
    return (
        f"{one.luts:5d} LUTs ({lut4} LUT4, {carry} CCU2C) {one.multipliers:2d} multipliers "
        f"{one.ffs:5d} registers {one.fmax_mhz:7.1f} MHz"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--format", type=int, nargs=2, default=(8, 23), metavar=("EXPONENT", "MANTISSA"))
    parser.add_argument("--only", choices=OPERATORS, help="one operator")
    parser.add_argument("--seeds", type=int, default=1, help="placements, of which the fastest counts")
    parser.add_argument("--latency", type=int, nargs="+", help="others than the usual")
    given = parser.parse_args()
    for name, (make, latencies) in OPERATORS.items():
        if given.only in (None, name):
            for subnormals in (True, False):
                form = Float(*given.format, subnormals=subnormals)
                for latency in given.latency or latencies:
                    figures = measured(make(form, latency - 1), given.seeds)
                    kept = "" if subnormals else "no subnormals, "
                    print(f"{name}, {form}, {kept}latency {latency}: {figures}", flush=True)


if __name__ == "__main__":
    main()
