"""Measure how many LUTs ECP5 operators take, and rewrite the tables ``[area]`` of the device files.

    python benchmarks/measure_areas.py            a few minutes

Every operator is the component that a design is made of, synthesised by itself, without registers. A LUT of
the device is a LUT4; a carry cell takes two.
"""

import re
import tomllib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from amaranth.hdl import Module, Mux, Shape, Value, signed, unsigned
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.arithmetic.division_structure import ONE, Operand, long_structure
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.arithmetic.product_structure import logic_addends
from kalmanhdl.rtl.divider import LongDivider
from kalmanhdl.rtl.leading_one import leading_zeros, shifted_left
from kalmanhdl.rtl.multiplier import Multiplier
from kalmanhdl.rtl.quantiser import quantised
from kalmanhdl.rtl.table import looked_up
from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.toolchain.yosys import cached_script
from kalmanhdl.toolchain.yowasp import YOSYS, ensure_warm, version

TARGET = Path(__file__).parent.parent / "src/kalmanhdl/target"
PARTS = ("ecp5-25k", "ecp5-45k", "ecp5-85k")
WIDTHS = (8, 16, 32)
LUTS = {"LUT4": 1, "CCU2C": 2, "PFUMX": 0, "L6MUX21": 0}


class Logic(Component):
    """One combinational function of inputs."""

    def __init__(self, inputs: dict[str, Shape], width: int, of: Callable[..., Value]) -> None:
        self.names, self.of = tuple(inputs), of
        super().__init__({**{name: In(shape) for name, shape in inputs.items()}, "q": Out(width)})

    def elaborate(self, platform: object) -> Module:
        m = Module()
        m.d.comb += self.q.eq(self.of(m, *(getattr(self, name) for name in self.names)))
        return m


@dataclass(frozen=True)
class Probe:
    """An operator, and the size by which its area is tabulated."""

    kind: str
    size: int
    component: Component


def probes() -> list[Probe]:
    found = []
    for w in WIDTHS:
        two = {"a": signed(w), "b": signed(w)}
        found.append(Probe("add", w, Logic(two, w + 1, lambda m, a, b: a + b)))
        found.append(Probe("select", w, Logic({**two, "f": unsigned(1)}, w, lambda m, a, b, f: Mux(f, a, b))))
        for kind, rounding in (("clamp", Rounding.FLOOR), ("round", Rounding.HALF_UP)):
            found.append(Probe(kind, w, _quantiser(w, rounding)))
        amount = {"a": unsigned(w), "n": unsigned((w - 1).bit_length())}
        shift = Logic(amount, w, lambda m, a, n, w=w: shifted_left(m, "s", a, n, w - 1)[w - 1 :])
        found.append(Probe("shift", w, shift))
        size = (w + 1).bit_length()
        found.append(Probe("leading_one", w, Logic({"a": unsigned(w)}, size, lambda m, a: leading_zeros(a))))
    found += [divider(w) for w in (8, 16)]
    for bits in (4, 6, 7, 8, 10):
        found.append(Probe("table", bits, _table(bits)))
    for a, b in ((4, 8), (8, 8), (8, 16), (16, 16)):
        core = Multiplier(signed(a), signed(b), on_block=False)
        found.append(Probe("multiply", logic_addends(a, True, b, True) * max(a, b), core))
    return found


def _quantiser(w: int, rounding: Rounding) -> Logic:
    form = Fixed(width=w, fraction=0)

    def of(m: Module, a: Value) -> Value:
        value, out = quantised(a, 8, form, rounding, Overflow.SATURATE)
        return value | out

    return Logic({"a": signed(w + 12)}, w, of)


def _table(bits: int) -> Logic:
    entries = [round(255 * (1 + k / 2**bits) ** -1) for k in range(2**bits)]
    return Logic({"a": unsigned(bits)}, 8, lambda m, a: looked_up(m, "t", a, entries, 8))


def divider(w: int) -> Probe:
    operand = Operand(form=Fixed(width=w, fraction=0, signed=False), low=1, high=(1 << w) - 1)
    form = Fixed(width=w, fraction=w - 1, signed=False)
    shape = long_structure(ONE, operand, form, Rounding.FLOOR, 2)
    return Probe("divide", shape.rows * shape.row_width, LongDivider(ONE, operand, form, Rounding.FLOOR))


def luts(probe: Probe) -> int:
    """By synthesis."""
    commands = ["read_rtlil probe.il", "synth_ecp5 -top probe", "tee -q -o cells.txt stat"]
    return _count(
        cached_script("areas", commands, {"probe.il": to_rtlil(probe.component, "probe")}, "cells.txt")
    )


def _count(statistics: str) -> int:
    cells = re.findall(
        r"^\s+(\d+)\s+(?:\S+\s+)?(LUT4|CCU2C)\b|^\s+(LUT4|CCU2C)\s+(\d+)", statistics, re.MULTILINE
    )
    return sum(int(a or d) * LUTS[b or c] for a, b, c, d in cells)


def tables() -> dict[str, list[tuple[int, int]]]:
    found = probes()
    result: dict[str, list[tuple[int, int]]] = {}
    with ThreadPoolExecutor(2) as pool:
        for probe, count in zip(found, pool.map(luts, found), strict=True):
            result.setdefault(probe.kind, []).append((probe.size, count))
            print(f"{probe.kind:12} {probe.size:6} {count:6} LUTs", flush=True)
    # A table gives eight bits here; its area is per bit.
    result["table"] = [(size, count / 8) for size, count in result["table"]]
    return {kind: sorted(rows) for kind, rows in result.items()}


def main() -> None:
    ensure_warm(YOSYS)
    measured = tables()
    head = f"# Written by benchmarks/measure_areas.py: LUTs by size, {version(YOSYS)}."
    lines = ["", head, "[area]"]
    lines += [f"{kind} = {[list(row) for row in rows]}" for kind, rows in measured.items()]
    for name in PARTS:
        path = TARGET / f"{name}.toml"
        text = path.read_text().split("\n# Written by benchmarks/measure_areas.py")[0].rstrip("\n")
        path.write_text(text + "\n" + "\n".join(lines) + "\n")
        tomllib.loads(path.read_text())


if __name__ == "__main__":
    main()
