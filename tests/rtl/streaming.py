"""Drive free-running cores with one set of operands a clock, as the Verilog text that a user gets."""

import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from amaranth.hdl import Cat, Module, ShapeLike, Signal, signed, unsigned
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.toolchain.yosys import rtlil_to_verilog

_BENCH = """
module bench;
  reg clk = 0; reg [{inputs}-1:0] stimuli; reg [{inputs}-1:0] table_ [0:{count}-1];
  wire [{outputs}-1:0] results; integer k;
  top dut({clock}.stimuli(stimuli), .results(results));
  initial begin
    $readmemh("{folder}/stimuli.hex", table_);
    for (k = 0; k < {cycles}; k = k + 1) begin
      stimuli = table_[k < {count} ? k : {count} - 1];
      #1 $display("%h", results);
      clk = 1; #1 clk = 0;
    end
  end
endmodule
"""


class _Side(Component):
    """Cores side by side, their operands and their outputs packed."""

    def __init__(self, cores: Sequence, operands: dict[str, ShapeLike], outputs: Sequence[str]) -> None:
        self.cores, self.operands = cores, operands
        self.taken = [[getattr(core, name) for name in outputs] for core in cores]
        width = sum(len(value) for values in self.taken for value in values)
        self.input_bits, self.output_bits = sum(s.width for s in operands.values()), width
        super().__init__({"stimuli": In(self.input_bits), "results": Out(width)})

    def elaborate(self, platform):
        m = Module()
        values = {name: Signal(shape, name=name) for name, shape in self.operands.items()}
        m.d.comb += Cat(*values.values()).eq(self.stimuli)
        for index, core in enumerate(self.cores):
            m.submodules[f"core_{index}"] = core
            m.d.comb += [getattr(core, name).eq(v) for name, v in values.items() if hasattr(core, name)]
        m.d.comb += self.results.eq(Cat(*(value for values in self.taken for value in values)))
        return m


def results(cores: Sequence, stimuli: Sequence[dict[str, int]], outputs: Sequence[str]) -> list[list[tuple]]:
    """For every core, its outputs for each stimulus, taken the core's ``registers`` clocks after it."""
    operands = {name: _shape([s[name] for s in stimuli]) for name in stimuli[0]}
    side = _Side(cores, operands, outputs)
    deepest = max(_registers(core) for core in cores)
    lines = _simulated(side, stimuli, len(stimuli) + deepest)
    taken, place = [], 0
    for core, values in zip(cores, side.taken, strict=True):
        window = lines[_registers(core) : _registers(core) + len(stimuli)]
        rows = [_unpacked(line >> place, values) for line in window]
        taken.append(rows)
        place += sum(len(value) for value in values)
    return taken


def repeated(
    core: Component, operands: Sequence[dict[str, int]], outputs: Sequence[str]
) -> tuple[list[tuple], list[int]]:
    """For a unit that takes a start: its outputs for each set of operands, and when it was done, in clocks.

    One start follows another as soon as it may; operands change as soon as they are taken.
    """
    idle = dict.fromkeys(operands[0], 0)
    stimuli = []
    for given in operands:
        others = [dict(operands[0], start=0), *[dict(idle, start=0)] * core.latency][: core.latency - 1]
        stimuli += [dict(given, start=1), *others]
    stimuli.append(dict(idle, start=0))
    [lines] = results([core], stimuli, (*outputs, "done"))
    places = range(core.latency, len(lines), core.latency)
    return [lines[k][:-1] for k in places], [k for k, line in enumerate(lines) if line[-1]]


def _registers(core: Component) -> int:
    return getattr(core, "registers", 0)


def _simulated(side: _Side, stimuli: Sequence[dict[str, int]], cycles: int) -> list[int]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = rtlil_to_verilog(to_rtlil(side, "top"), "top")
        (folder / "top.v").write_text(text)
        bench = _BENCH.format(
            inputs=side.input_bits,
            outputs=side.output_bits,
            count=len(stimuli),
            cycles=cycles,
            folder=folder,
            clock=".clk(clk), .rst(1'b0), " if "input clk" in text else "",
        )
        (folder / "bench.v").write_text(bench)
        words = (_packed(stimulus, side.operands) for stimulus in stimuli)
        (folder / "stimuli.hex").write_text("".join(f"{word:x}\n" for word in words))
        files = [str(folder / file) for file in ("bench.v", "top.v")]
        subprocess.run(["iverilog", "-g2005", "-o", str(folder / "bench"), *files], check=True)
        run = subprocess.run(["vvp", str(folder / "bench")], check=True, capture_output=True, text=True)
    # Nothing is known before the first stimulus arrives.
    return [int(line.replace("x", "0").replace("X", "0"), 16) for line in run.stdout.split()]


def _shape(values: Sequence[int]) -> ShapeLike:
    width = max(max(v.bit_length(), (~v).bit_length() + 1 if v < 0 else 1) for v in values) + 1
    return signed(width) if min(values) < 0 else unsigned(width)


def _packed(stimulus: dict[str, int], operands: dict[str, ShapeLike]) -> int:
    word, place = 0, 0
    for name, shape in operands.items():
        word |= (stimulus[name] & ((1 << shape.width) - 1)) << place
        place += shape.width
    return word


def _unpacked(word: int, values: Sequence) -> tuple[int, ...]:
    numbers = []
    for value in values:
        raw = word & ((1 << len(value)) - 1)
        if value.shape().signed and raw >> (len(value) - 1):
            raw -= 1 << len(value)
        numbers.append(raw)
        word >>= len(value)
    return tuple(numbers)
