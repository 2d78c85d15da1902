"""Registers as a history: the same design, whatever its registers look like."""

import re

import numpy as np
import pytest

from kalmanhdl.toolchain.cxxrtl import build_library
from kalmanhdl.toolchain.harness import Border, Stream
from kalmanhdl.toolchain.histories import with_histories
from kalmanhdl.toolchain.simulation import Simulation, Stalls

# Beside a delay of five: a register that starts at one and delays, one with an enable, one with a reset, a
# ring of two that only delay each other, a port that is itself a register, and a chain of a wider one.
VERILOG = """
module top(input clk, input rst, input in_valid, output in_ready, input [7:0] in_a,
  output out_valid, input out_ready, output reg [7:0] out_a, output [7:0] out_sum, output [69:0] out_wide);
  reg [7:0] d1 = 0, d2 = 0, d3 = 0, d4 = 0, d5 = 0, count = 0, held = 0;
  reg started = 1, late = 1, later = 0, ring0 = 0, ring1 = 1, valid = 0;
  reg [69:0] wide0 = 0, wide1 = 0, wide2 = 0;
  assign in_ready = 1, out_valid = valid, out_wide = wide2;
  assign out_sum = d5 + held + {count[3:0], started, late, later, ring0};
  always @(posedge clk) begin
    valid <= in_valid; out_a <= in_a;
    d1 <= in_a; d2 <= d1; d3 <= d2; d4 <= d3; d5 <= d4;
    started <= ^d5; late <= started; later <= late; ring0 <= ring1; ring1 <= ring0;
    wide0 <= {wide0[61:0], in_a}; wide1 <= wide0; wide2 <= wide1;
    if (in_a[0]) held <= d3;
    if (rst) count <= 0; else count <= count + d2;
    if (rst) valid <= 0;
  end
endmodule
"""
BORDER = Border(
    source=Stream(valid="in_valid", ready="in_ready", payload=(("in_a", 8),)),
    sink=Stream(
        valid="out_valid", ready="out_ready", payload=(("out_a", 8), ("out_sum", 8), ("out_wide", 70))
    ),
)
# The cycles of reset before the first token.
RESET_CYCLES = 4


def expected(tokens):
    """What comes out when a token enters in every cycle, from the definition of the Verilog."""
    past = [0] * 5
    count = held = started = wide = 0
    late = later = 0
    ring = [0, 1]
    wides, rows = [0, 0, 0], []
    for cycle, a in enumerate([0] * RESET_CYCLES + [int(t) for t in tokens[:, 0]]):
        if cycle == 0:
            started, late = 1, 1
        delays = list(past)
        started, late, later = delays[4].bit_count() % 2, started, late
        ring = ring[::-1]
        wide = (wide << 8 | a) & (1 << 70) - 1
        wides = [wide, *wides[:2]]
        held = delays[2] if a & 1 else held
        count = 0 if cycle < RESET_CYCLES else (count + delays[1]) % 256
        past = [a, *delays[:4]]
        bits = (count % 16) << 4 | started << 3 | late << 2 | later << 1 | ring[0]
        rows.append((a, (past[4] + held + bits) % 256, wides[2] & (1 << 64) - 1, wides[2] >> 64))
    return np.array(rows[RESET_CYCLES:], np.uint64)


@pytest.mark.parametrize("optimised", [True, False])
def test_every_kind_of_register_keeps_its_value(optimised):
    tokens = np.random.default_rng(0).integers(0, 256, (500, 1), np.uint64)
    library = build_library(VERILOG, "top", BORDER, optimised=optimised)
    with Simulation(library, BORDER) as simulation:
        outputs = simulation.run(tokens, 500, Stalls()).outputs
    assert np.array_equal(outputs, expected(tokens))


CODE = """
struct p_top : public module {
\twire<8> p_a;
\twire<8> p_b;
\twire<8> p_c;
\twire<8> p_seen;
\twire<1> p_twice;
\tbool commit() {
\t\tbool changed = false;
\t\tif (p_a.commit(observer)) changed = true;
\t\tif (p_b.commit(observer)) changed = true;
\t\tif (p_c.commit(observer)) changed = true;
\t\tif (p_seen.commit(observer)) changed = true;
\t\tif (p_twice.commit(observer)) changed = true;
\t}
};
\tp_a = wire<8>{0u};
\tp_b = wire<8>{0u};
\tp_c = wire<8>{0x5u};
\tbool posedge_p_clk = this->posedge_p_clk();
\tif (posedge_p_clk) {
\t\tp_a.next = f(p_c.curr);
\t}
\tif (posedge_p_clk) {
\t\t// a note
\t\tp_b.next = p_a.curr;
\t}
\tif (posedge_p_clk) {
\t\tp_c.next = p_b.curr;
\t}
\tif (posedge_p_clk) {
\t\tp_seen.next = p_b.curr;
\t}
\tif (posedge_p_clk) {
\t\tp_twice.next = g();
\t}
\tp_twice.next = h(p_twice.curr);
"""


def test_a_delay_is_a_look_back_and_has_no_code_of_its_own():
    code = with_histories(CODE, {"p_seen"})
    assert "p_b" not in code
    assert "now[1].p_a = f(now[0].p_c);" in code
    # It starts at five, where the rows before the first hold zero: so it has a column of its own.
    assert "now[1].p_c = now[-1].p_a;" in code
    assert "now->p_c = value<8>{0x5u};" in code


def test_registers_that_others_read_or_that_are_written_twice_stay():
    code = with_histories(CODE, {"p_seen"})
    for name in ("p_seen", "p_twice"):
        assert re.search(rf"wire<\d> {name};", code)
        assert f"{name}.commit(observer)" in code
    assert "p_seen.next = now[-1].p_a;" in code


def test_code_without_registers_is_unchanged():
    assert (
        with_histories("struct p_top : public module {\n};\n", ()) == "struct p_top : public module {\n};\n"
    )
