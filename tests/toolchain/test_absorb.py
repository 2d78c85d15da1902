import numpy as np
import pytest

from kalmanhdl.toolchain.absorb import absorb_registers
from kalmanhdl.toolchain.cxxrtl import build_library
from kalmanhdl.toolchain.harness import Border, Stream
from kalmanhdl.toolchain.simulation import Simulation, Stalls
from kalmanhdl.toolchain.yosys import Netlist, run_script, synthesise_ecp5

pytestmark = pytest.mark.slow

BORDER = Border(
    source=Stream(valid="in_valid", ready="in_ready", payload=(("a", 16), ("b", 16))),
    sink=Stream(valid="out_valid", ready="out_ready", payload=(("q", 32),)),
)

# The multiplier block as its data sheet describes it, of what the tests use.
BLOCK = f"""
module MULT18X18D({", ".join(f"input A{k}, B{k}, C{k}" for k in range(18))},
    input SIGNEDA, SIGNEDB, SOURCEA, SOURCEB, CLK0, CE0, CE1, RST0,
    {", ".join(f"output P{k}" for k in range(36))});
  parameter REG_INPUTA_CLK = "NONE", REG_INPUTA_CE = "CE0", REG_INPUTA_RST = "RST0";
  parameter REG_INPUTB_CLK = "NONE", REG_INPUTB_CE = "CE1", REG_INPUTB_RST = "RST0";
  parameter REG_OUTPUT_CLK = "NONE", REG_OUTPUT_CE = "CE0", REG_OUTPUT_RST = "RST0";
  wire signed [17:0] a = {{{", ".join(f"A{k}" for k in reversed(range(18)))}}};
  wire signed [17:0] b = {{{", ".join(f"B{k}" for k in reversed(range(18)))}}};
  reg signed [17:0] ra = 0, rb = 0;
  wire signed [17:0] fa = REG_INPUTA_CLK == "NONE" ? a : ra, fb = REG_INPUTB_CLK == "NONE" ? b : rb;
  wire signed [35:0] p = fa * fb;
  reg signed [35:0] rp = 0;
  always @(posedge CLK0) begin if (CE0) ra <= a; if (CE1) rb <= b; if (CE0) rp <= p; end
  assign {{{", ".join(f"P{k}" for k in reversed(range(36)))}}} = REG_OUTPUT_CLK == "NONE" ? p : rp;
endmodule
"""


def design(product: str) -> str:
    return f"""module top(input clk, input rst, input in_valid, output in_ready, input signed [15:0] a, b,
      output out_valid, input out_ready, output [31:0] q);
      reg [2:0] valid = 0; reg signed [15:0] ra = 0, rb = 0; reg signed [31:0] p = 0, r = 0;
      wire go = out_ready | ~valid[2];
      assign in_ready = go, out_valid = valid[2], q = r;
      always @(posedge clk) begin
        if (go) begin valid <= {{valid[1:0], in_valid}}; ra <= a; rb <= b; p <= {product}; r <= p ^ 5; end
        if (rst) valid <= 0;
      end
    endmodule"""


def simulate(netlist: Netlist, tokens: np.ndarray) -> np.ndarray:
    commands = (
        "read_json netlist.json",
        "techmap -autoproc -map +/ecp5/cells_sim.v -map block.v",
        "select -module top",
        "opt_clean",
        "write_verilog -noattr -selected flat.v",
    )
    flat = run_script(commands, {"netlist.json": netlist.json, "block.v": BLOCK}, "flat.v")
    with Simulation(build_library(flat, "top", BORDER), BORDER) as simulation:
        return simulation.run(tokens, len(tokens), Stalls(seed=1, source=0.3, sink=0.3)).outputs


@pytest.mark.parametrize(
    ("product", "registers", "block"),
    [("ra * rb", 32, "REG_OUTPUT_CLK"), ("ra * rb + 7", 32, "REG_INPUTA_CLK")],
    ids=["product registers", "operand registers"],
)
def test_absorbed_registers_compute_the_same_with_fewer_flip_flops(product, registers, block):
    before = synthesise_ecp5(design(product), "top")
    after = absorb_registers(before)
    assert after.cells["TRELLIS_FF"] == before.cells["TRELLIS_FF"] - registers
    assert f'"{block}": "CLK0"' in after.json
    tokens = np.random.default_rng(0).integers(0, 2**16, (500, 2), np.uint64)
    assert np.array_equal(simulate(after, tokens), simulate(before, tokens))


def test_registers_with_a_reset_stay_where_they_are():
    text = design("ra * rb + 7").replace("valid <= 0;", "begin valid <= 0; ra <= 0; end")
    before = synthesise_ecp5(text, "top")
    assert absorb_registers(before).cells == before.cells


def test_absorbing_twice_changes_nothing_more():
    once = absorb_registers(synthesise_ecp5(design("ra * rb"), "top"))
    assert absorb_registers(once) == once
