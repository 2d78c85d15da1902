import re

import pytest

from kalmanhdl.errors import ToolError
from kalmanhdl.toolchain.yosys import rtlil_to_verilog, synthesise_ecp5

RTLIL = r"""
attribute \generator "Amaranth"
attribute \src "/home/somebody/design.py:7"
module \top
  wire width 8 input 0 \a
  wire width 1 input 1 \clk
  attribute \init 8'00000101
  attribute \keep 1
  attribute \src "/home/somebody/design.py:8"
  wire width 8 output 2 \state
  wire width 8 \second_name
  wire width 8 \read_by_nobody
  attribute \keep 1
  wire width 8 \watched
  connect \second_name \a
  cell $not $3
    parameter \A_SIGNED 0
    parameter \A_WIDTH 8
    parameter \Y_WIDTH 8
    connect \A \a
    connect \Y \read_by_nobody
  end
  cell $add $1
    parameter \A_SIGNED 0
    parameter \A_WIDTH 8
    parameter \B_SIGNED 0
    parameter \B_WIDTH 8
    parameter \Y_WIDTH 8
    connect \A \a
    connect \B \state
    connect \Y \watched
  end
  cell $dff $2
    parameter \CLK_POLARITY 1
    parameter \WIDTH 8
    connect \CLK \clk
    connect \D \watched
    connect \Q \state
  end
end
"""


@pytest.fixture(scope="module")
def verilog() -> str:
    return rtlil_to_verilog(RTLIL, "top", header="made by a test\n\nfor a reader")


def test_verilog_begins_with_the_header_and_keeps_names_and_initial_values(verilog):
    assert verilog.startswith("// made by a test\n//\n// for a reader\n")
    assert re.search(r"assign watched = a \+ state;", verilog)
    assert re.search(r"reg \[7:0\] state = 8'h05;", verilog)


def test_verilog_tells_nothing_of_tools_paths_and_times(verilog):
    assert not re.search(r"Yosys|Amaranth|/home|src *=", verilog)


def test_attributes_that_steer_synthesis_stay(verilog):
    assert "(* keep" in verilog


def test_what_nobody_reads_and_second_names_are_left_out_but_kept_wires_stay(verilog):
    assert "read_by_nobody" not in verilog
    assert "second_name" not in verilog
    assert re.search(r"\(\* keep = .*\*\)\n +wire \[7:0\] watched;", verilog)


def test_the_same_rtlil_gives_the_same_text(verilog, own_cache):
    assert rtlil_to_verilog(RTLIL, "top", header="made by a test\n\nfor a reader") == verilog


def test_a_broken_design_shows_the_error_of_yosys(own_cache):
    with pytest.raises(ToolError, match=r"ERROR: .*nowhere"):
        rtlil_to_verilog(RTLIL, "nowhere")


@pytest.mark.slow
def test_an_ecp5_netlist_counts_its_cells():
    text = "module top(input clk, input [7:0] a, output reg [7:0] q); always @(posedge clk) q <= a; endmodule"
    netlist = synthesise_ecp5(text, "top")
    assert netlist.cells == {"TRELLIS_FF": 8}
