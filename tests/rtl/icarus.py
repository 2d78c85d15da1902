"""Run a filter's Verilog in Icarus Verilog, with a testbench that knows only its interface."""

import subprocess
from collections.abc import Iterable
from pathlib import Path

from steps import Given

from kalmanhdl.rtl.interface import COMMAND_WIDTH, Interface, Port, StateWrite

_BENCH = """
module bench;
  reg clk = 0, rst = 1, in_valid = 0, out_ready = 0, offered = 0;
  {declarations}
  reg [{word_bits}-1:0] steps [0:{count}-1];
  integer index = 0, given = 0, clocks = 0, rest = 0;
  wire in_ready, out_valid;
  always #5 clk = ~clk;
  {top} dut(.clk(clk), .rst(rst), .in_valid(in_valid), .in_ready(in_ready), .out_valid(out_valid),
    .out_ready(out_ready){connections});
  initial $readmemh("steps.hex", steps);
  always @(negedge clk) begin
    clocks = clocks + 1;
    rst = clocks < 4;
    if (clocks > 4) begin
      if (!offered && index < {count} && $random % 4 != 0) offered = 1;
      in_valid = offered;
      if (offered) {{{inputs}}} = steps[index];
      out_ready = $random % 4 != 0;
    end
    // States may still be written when the last result is out.
    if (given == {count}) rest = rest + 1;
    if (rest > 300) $finish;
    if (clocks > 400 * {count}) $finish;
  end
  always @(posedge clk) if (!rst) begin
    if (in_valid && in_ready) begin index = index + 1; offered = 0; end
    if (out_valid && out_ready) begin given = given + 1; $display("result{formats}"{outputs}); end
    {watches}
  end
endmodule
"""


def simulate(
    folder: Path, verilog: str, top: str, shown: Interface, steps: list[Given]
) -> tuple[list[dict[str, int]], dict[str, list[int]]]:
    """What came out, by port; and for each state its new values, step by step."""
    (folder / "design.v").write_text(verilog)
    (folder / "bench.v").write_text(_bench(top, shown, len(steps)))
    (folder / "steps.hex").write_text("\n".join(_word(shown, step) for step in steps) + "\n")
    subprocess.run(["iverilog", "-o", "run", "design.v", "bench.v"], cwd=folder, check=True)
    run = subprocess.run(["vvp", "-n", "run"], cwd=folder, check=True, capture_output=True, text=True)
    results, states = [], {write.state: [] for write in shown.states}
    forms = {write.state: write for write in shown.states}
    for line in run.stdout.splitlines():
        kind, *words = line.split()
        if kind == "result":
            pairs = zip(_outputs(shown), words, strict=True)
            results.append({name: _value(port, word) for (name, _, port), word in pairs})
        elif kind in states:
            states[kind].append(_value(forms[kind], words[0]))
    return results, states


def _inputs(shown: Interface) -> list[tuple[str, int]]:
    track = [("in_track", shown.track_width)] if shown.track_width else []
    ports = [(port.name, port.width) for port in (*shown.numbers, *shown.present)]
    return [*track, ("in_command", COMMAND_WIDTH), *ports]


def _outputs(shown: Interface) -> list[tuple[str, int, Port | None]]:
    track = [("out_track", shown.track_width, None)] if shown.track_width else []
    return [*track, ("out_command", COMMAND_WIDTH, None), *((p.name, p.width, p) for p in shown.outputs)]


def _bench(top: str, shown: Interface, count: int) -> str:
    inputs, outputs = _inputs(shown), _outputs(shown)
    declarations = [f"reg [{width - 1}:0] {name};" for name, width in inputs]
    declarations += [f"wire [{width - 1}:0] {name};" for name, width, _ in outputs]
    return _BENCH.format(
        declarations="\n  ".join(declarations),
        word_bits=sum(width for _, width in inputs),
        count=count,
        top=top,
        connections="".join(f", .{name}({name})" for name in _names(inputs, outputs)),
        inputs=", ".join(name for name, _ in inputs),
        formats=" %h" * len(outputs),
        outputs="".join(f", {name}" for name, _, _ in outputs),
        watches="\n    ".join(
            f'if (dut.{w.enable}) $display("{w.state} %h", dut.{w.data});' for w in shown.states
        ),
    )


def _names(*ports: Iterable[tuple]) -> list[str]:
    return [port[0] for group in ports for port in group]


def _word(shown: Interface, step: Given) -> str:
    values = {"in_track": step.track, "in_command": step.command, **step.ports}
    word = 0
    for name, width in _inputs(shown):
        word = word << width | values[name] & (1 << width) - 1
    return f"{word:x}"


def _value(port: Port | StateWrite | None, word: str) -> int:
    raw = int(word, 16)
    form = port.form if port else None
    if form and form.signed and raw >> (form.width - 1):
        raw -= 1 << form.width
    return raw
