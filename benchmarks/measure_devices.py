"""Measure how long ECP5 logic takes, and rewrite the device files in ``src/kalmanhdl/target``.

    python benchmarks/measure_devices.py            measure everything (several minutes)
    python benchmarks/measure_devices.py --check    also compare chains of operators with the estimate

Every piece of logic stands between registers on a clock of its own, all in one core; nextpnr reports the
longest path of each clock. Measured on the smallest part: the logic of a speed grade is the same on all.
"""

import argparse
import json
import random
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from kalmanhdl.toolchain.absorb import absorb_registers
from kalmanhdl.toolchain.process import Job, run_all, working_folder
from kalmanhdl.toolchain.yosys import synthesise_ecp5
from kalmanhdl.toolchain.yowasp import NEXTPNR_ECP5, YOSYS, ensure_warm, version

TARGET = Path(__file__).parent.parent / "src/kalmanhdl/target"
GRADES = (6, 7, 8)
SEEDS = (1, 2)
COPIES = 2

# Lattice, ECP5 family data sheet FPGA-DS-02012, table 1.1; packages are those of nextpnr.
PARTS = {
    "ecp5-25k": {"luts": 24288, "ffs": 24288, "multipliers": 28, "block_rams": 56, "package": "CABGA381"},
    "ecp5-45k": {"luts": 43848, "ffs": 43848, "multipliers": 72, "block_rams": 108, "package": "CABGA381"},
    "ecp5-85k": {"luts": 83640, "ffs": 83640, "multipliers": 156, "block_rams": 208, "package": "CABGA756"},
}


@dataclass(frozen=True)
class Probe:
    """Logic between registers: inputs (name, width), the result's width, an expression or statements."""

    inputs: tuple[tuple[str, int], ...]
    width: int
    expression: str
    statements: str = ""


def probes() -> dict[tuple[str, int], Probe]:
    two = {w: (("a", w), ("b", w)) for w in (8, 16, 18, 32, 64)}
    found = {("add", w): Probe(two[w], w, "a + b") for w in (8, 16, 32, 64)}
    found[("multiply", 18)] = Probe(two[18], 36, "$signed(a) * $signed(b)")
    for w in (8, 16, 32):
        limits = f"$signed(a) > {2 ** (w - 2) - 37} || $signed(a) < -{2 ** (w - 3) + 91}"
        found[("compare", w)] = Probe((("a", w),), 1, limits)
        found[("select", w)] = Probe((*two[w], ("flag", 1)), w, "flag ? a : b")
        found[("shift", w)] = Probe((("a", w), ("n", w.bit_length() - 1)), w, "a << n")
        found[("leading_one", w)] = _leading_one(w)
    for bits in (4, 6, 8, 10):
        found[("table", bits)] = _table(bits)
    return found


def _leading_one(width: int) -> Probe:
    cases = "".join(f"if (a[{i}]) r = {i};" for i in range(width))
    size = (width - 1).bit_length()
    return Probe((("a", width),), size, "r", f"reg [{size - 1}:0] r; always @* begin r = 0; {cases} end")


def _table(bits: int) -> Probe:
    values = random.Random(bits)
    words = "".join(f"rom[{i}] = {values.randrange(16)};" for i in range(2**bits))
    # Without the attribute Yosys takes a block memory for the larger ones.
    rom = f'(* ram_style = "logic" *) reg [3:0] rom [0:{2**bits - 1}];'
    return Probe((("a", bits),), 4, "rom[a]", f"{rom} initial begin {words} end")


def chains() -> dict[str, tuple[Probe, tuple[tuple[str, int], ...]]]:
    four = (("a", 16), ("b", 16), ("c", 16), ("g", 16))
    adds = Probe((*four, ("e", 16)), 16, "(((a + b) ^ c) + g ^ e) + a")
    mixed = Probe((*four, ("e", 32)), 32, "$signed(s + g) * $signed(b) + e", "wire [15:0] s = (a + b) ^ c;")
    mux = Probe((*four, ("f", 1)), 16, "(f ? a + b : c) + g")
    return {
        "add-xor-add-xor-add": (
            adds,
            (("add", 16), ("select", 16), ("add", 16), ("select", 16), ("add", 16)),
        ),
        "add-xor-add-multiply-add": (
            mixed,
            (("add", 16), ("select", 16), ("add", 16), ("multiply", 18), ("add", 32)),
        ),
        "add-select-add": (mux, (("add", 16), ("select", 16), ("add", 16))),
    }


def module(name: str, probe: Probe) -> str:
    wires = "".join(f"reg [{w - 1}:0] {n};" for n, w in probe.inputs)
    total, taken = sum(w for _, w in probe.inputs), 0
    loads = ""
    for n, w in probe.inputs:
        loads += f"{n} <= d[{taken}+:{w}];"
        taken += w
    return (
        f"module {name}(input clk, input [{total - 1}:0] d, output reg [{probe.width - 1}:0] q);\n"
        f"{wires} {probe.statements}\n"
        f"always @(posedge clk) begin {loads} q <= {probe.expression}; end\nendmodule\n"
    )


def memory_module(name: str, depth: int) -> str:
    """A memory with a clock for reading and one for writing, so that either has its own figure."""
    bits = (depth - 1).bit_length()
    return f"""module {name}(input clk, input read_clk, input [{bits * 2 + 36}:0] d, output reg [35:0] q);
      reg [35:0] m [0:{depth - 1}], w, r; reg [{bits - 1}:0] wa, ra; reg we;
      always @(posedge clk) begin {{we, wa, w}} <= d; if (we) m[wa] <= w; end
      always @(posedge read_clk) begin ra <= d[{bits + 36}+:{bits}]; r <= m[ra]; q <= r; end
      endmodule\n"""


MEMORIES = {16: "memory16", 32: "memory32", 48: "memory48", 512: "memory512"}


def core(check: bool) -> str:
    """The whole core; the clock of every copy is a port named after what it measures."""
    logic = {f"{kind}_{size}": probe for (kind, size), probe in probes().items()}
    if check:
        logic |= {f"chain_{k}": probe for k, (probe, _) in enumerate(chains().values())}
    modules = [module(name, probe) for name, probe in logic.items()]
    modules += [memory_module(name, depth) for depth, name in MEMORIES.items()]
    ports, uses, total = ["input [299:0] d"], [], 0
    for copy in range(COPIES):
        for name, probe in logic.items():
            ports.append(f"input {name}_copy{copy}")
            use = f"{name} u_{name}_{copy}(.clk({name}_copy{copy}), .d(d), .q(q[{total}+:{probe.width}]));"
            uses.append(use)
            total += probe.width
        for name in MEMORIES.values():
            ports += [f"input {name}_write_copy{copy}", f"input {name}_read_copy{copy}"]
            clocks = f".clk({name}_write_copy{copy}), .read_clk({name}_read_copy{copy})"
            uses.append(f"{name} u_{name}_{copy}({clocks}, .d(d), .q(q[{total}+:36]));")
            total += 36
    ports.append(f"output [{total - 1}:0] q")
    return "".join(modules) + f"module top({', '.join(ports)});\n" + "\n".join(uses) + "\nendmodule\n"


def measure(check: bool) -> dict[int, dict[str, list[tuple[float, float]]]]:
    """By grade and name: (longest path, of it clock-to-output plus setup) of every copy and seed, in ns."""
    netlist = absorb_registers(synthesise_ecp5(core(check), "top"))
    print(netlist.cells)
    ensure_warm(NEXTPNR_ECP5)
    found: dict[int, dict[str, list[tuple[float, float]]]] = {grade: {} for grade in GRADES}
    with working_folder() as work:
        jobs = []
        for grade in GRADES:
            for seed in SEEDS:
                folder = work / f"{grade}-{seed}"
                folder.mkdir()
                (folder / "netlist.json").write_text(netlist.json)
                options = f"--25k --package CABGA381 --speed {grade} --seed {seed} --freq 250"
                files = "--json netlist.json --report report.json --quiet"
                arguments = (*f"{options} {files}".split(), "--out-of-context", "--timing-allow-fail")
                jobs.append(Job(tool=NEXTPNR_ECP5, arguments=arguments, folder=folder))
        run_all(jobs, parallel=2)
        for job in jobs:
            collect(json.loads((job.folder / "report.json").read_text()), found[int(job.folder.name[0])])
    return found


def collect(report: dict, found: dict[str, list[tuple[float, float]]]) -> None:
    for path in report["critical_paths"]:
        if path["from"] == "<async>" or path["from"] != path["to"]:
            continue
        delays = [(hop["type"], hop["delay"]) for hop in path["path"]]
        ends = sum(delay for kind, delay in delays if kind in ("clk-to-q", "setup"))
        name = path["from"].split()[-1].split("$")[0].rsplit("_copy", 1)[0]
        found.setdefault(name, []).append((sum(delay for _, delay in delays), ends))


def delays(found: dict[str, list[tuple[float, float]]]) -> dict[str, list[tuple[int, float]]]:
    """The tables of a device file; a stage is estimated as register plus the sum of its parts."""
    register = median(ends for name, all_ in found.items() if name.startswith("add") for _, ends in all_)
    tables: dict[str, list[tuple[int, float]]] = {"register": [(1, round(register, 3))]}

    def middle(name: str) -> float:
        return round(max(0.0, median(path for path, _ in found[name]) - register), 3)

    for kind, size in probes():
        tables.setdefault(kind, []).append((size, middle(f"{kind}_{size}")))
    for depth, name in MEMORIES.items():
        # Up to 32 words are distributed memory, more are block memory: a step, not a slope.
        at = 33 if depth == 48 else depth
        tables.setdefault("context_read", []).append((at, middle(f"{name}_read")))
        tables.setdefault("context_write", []).append((at, middle(f"{name}_write")))
    return tables


def write(name: str, grades: dict[int, dict[str, list[tuple[float, float]]]]) -> None:
    lines = ["# Written by benchmarks/measure_devices.py; do not edit."]
    lines += [f'name = "{name}"', 'family = "ecp5"']
    lines += [f"{key} = {json.dumps(value)}" for key, value in PARTS[name].items()]
    lines += ["multiplier_width = 18", f'measured_with = "{version(YOSYS)}, {version(NEXTPNR_ECP5)}"']
    for grade, found in grades.items():
        measured = {kind: dict(table) for kind, table in delays(found).items()}
        # A deep pipeline has room for a product and a choice behind it in one stage.
        period = measured["register"][1] + measured["multiply"][18] + measured["select"][16]
        lines += ["", f"[grade.{grade}]", f"pipelined_period_ns = {period:.2f}", f"[grade.{grade}.delays]"]
        for kind, table in delays(found).items():
            lines.append(f"{kind} = {json.dumps(table)}")
    path = TARGET / f"{name}.toml"
    # What benchmarks/measure_areas.py found stays.
    _, mark, areas = path.read_text().partition("\n# Written by benchmarks/measure_areas.py")
    path.write_text("\n".join(lines) + "\n" + mark + areas)


def report_chains(grades: dict[int, dict[str, list[tuple[float, float]]]]) -> None:
    from kalmanhdl.target import device

    for grade, found in grades.items():
        part = device("ecp5-25k", grade)
        for index, (name, (_, parts)) in enumerate(chains().items()):
            true = median(path for path, _ in found[f"chain_{index}"])
            guess = part.delay_ns("register", 1) + sum(part.delay_ns(*one) for one in parts)
            error = f"{guess / true - 1:+.0%}"
            print(f"grade {grade} {name}: measured {true:.2f} ns, estimated {guess:.2f} ({error})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare chains of operators with the estimate")
    check = parser.parse_args().check
    found = measure(check)
    for name in PARTS:
        write(name, found)
    if check:
        report_chains(found)


if __name__ == "__main__":
    main()
