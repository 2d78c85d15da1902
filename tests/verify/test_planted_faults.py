"""The faults that are planted, and the proofs that some of them are none."""

import re

import pytest

from equivalence import proof
from kalmanhdl.toolchain.yosys import run_script
from planted_faults import plant

# Two modules: a counter that can be held, and a sum of it and a table entry, rounded.
VERILOG = """\
module top(clk, rst, hold, out);
  input clk;
  wire clk;
  input rst;
  wire rst;
  input hold;
  wire hold;
  output [7:0] out;
  wire [7:0] out;
  wire [3:0] _0_;
  wire [3:0] _1_;
  reg [3:0] count = 4'h0;
  \\top.datapath  datapath (
    .clk(clk),
    .count(count),
    .sum(out)
  );
  assign _0_ = count + 1'h1;
  assign _1_ = hold ? count : _0_;
  always @(posedge clk)
    count <= rst ? 4'h0 : _1_;
endmodule

module \\top.datapath (clk, count, sum);
  input clk;
  wire clk;
  input [3:0] count;
  wire [3:0] count;
  output [7:0] sum;
  reg [7:0] sum = 8'h00;
  wire [9:0] exact;
  wire [5:0] entry;
  wire outside;
  reg [5:0] entry_table [3:0];
  initial begin
    entry_table[0] = 6'h11;
    entry_table[1] = 6'h22;
    entry_table[2] = 6'h33;
    entry_table[3] = 6'h04;
  end
  assign entry = entry_table[count[3:2]];
  assign outside = (count == 4'hf) & ~ entry[0];
  assign exact = $signed({ entry, 2'h0 }) - $signed({ 4'h0, count });
  always @(posedge clk)
    sum <= outside ? 8'h80 : exact[9:2];
endmodule
"""

SEEDS = range(60)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_fault_changes_one_place_on_the_line_that_it_names(seed):
    fault = plant(VERILOG, seed)
    lines = VERILOG.splitlines(keepends=True)
    before, rest = "".join(lines[: fault.line - 1]), "".join(lines[fault.line - 1 :])
    begin = next(
        m.start()
        for m in re.finditer(re.escape(fault.before), rest)
        if before + rest[: m.start()] + fault.after + rest[m.end() :] == fault.verilog
    )
    assert "\n" not in rest[:begin]
    assert fault.verilog != VERILOG


def test_faults_are_verilog():
    texts = {f"fault{seed}.v": plant(VERILOG, seed).verilog for seed in SEEDS}
    commands = [
        line for name in texts for line in (f"read_verilog {name}", "hierarchy -check -top top", "delete")
    ]
    run_script([*commands, "tee -o done.txt log done"], texts, "done.txt")


def test_every_kind_and_both_parts_of_a_design_have_their_faults():
    kinds = {plant(VERILOG, seed).kind for seed in SEEDS}
    assert {kind.split(",")[0] for kind in kinds} == {"constant", "shift", "operator", "register"}
    assert {"constant, entry of a table in datapath", "register, reset missing in control"} <= kinds
    assert all(re.search(r" in (control|datapath)$", kind) for kind in kinds)


def test_equal_seeds_plant_equal_faults_and_another_attempt_another_one():
    assert plant(VERILOG, 5) == plant(VERILOG, 5)
    others = [plant(VERILOG, 5, attempt) for attempt in range(10)]
    assert len({other.verilog for other in others}) > 1
    assert others[0].kind == others[2].kind != others[3].kind


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("hold ? count : _0_", "hold ? _0_ : count"),
        ("6'h22", "6'h23"),
        ("8'h80", "8'h81"),
        ("rst ? 4'h0 : _1_", "_1_"),
        ("exact[9:2]", "exact[8:1]"),
    ],
)
def test_a_change_that_shows_is_not_proven_to_be_none(before, after):
    assert proof(VERILOG, VERILOG.replace(before, after), "top") == ""


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("count + 1'h1", "1'h1 + count"),
        # The wire exact differs in a bit that nobody reads: it is looked through.
        (
            "$signed({ entry, 2'h0 }) - $signed({ 4'h0, count })",
            "($signed({ entry, 2'h0 }) - $signed({ 4'h0, count })) ^ $signed(10'h001)",
        ),
        ("(count == 4'hf) & ~ entry[0]", "(& count) & ~ entry[0]"),
    ],
)
def test_a_change_that_changes_nothing_is_proven(before, after):
    assert "are the same function" in proof(VERILOG, VERILOG.replace(before, after), "top")
