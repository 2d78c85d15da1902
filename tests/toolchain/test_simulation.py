import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.toolchain.cxxrtl import _COPIES, _translated, build_library
from kalmanhdl.toolchain.harness import Border, Stream
from kalmanhdl.toolchain.simulation import Simulation, Stalls

# A pipeline of three stages: the product of two signed numbers beside 70 bits passed on, running count.
VERILOG = """
module top(input clk, input rst, input in_valid, output in_ready, input signed [15:0] in_a, in_b,
  input [69:0] \\in_p.wide , output out_valid, input out_ready, output signed [31:0] out_product,
  output [69:0] out_wide, output [7:0] out_count);
  reg [2:0] valid = 0; reg [101:0] stage0, stage1, stage2; reg [7:0] count = 0;
  wire go = out_ready | ~valid[2];
  wire signed [31:0] product = $signed(stage0[31:16]) * $signed(stage0[15:0]);
  assign in_ready = go, out_valid = valid[2], out_product = stage2[31:0], out_wide = stage2[101:32];
  assign out_count = count;
  always @(posedge clk) begin
    if (go) begin
      valid <= {valid[1:0], in_valid};
      stage0 <= {\\in_p.wide , in_a, in_b};
      stage1 <= {stage0[101:32], product};
      stage2 <= stage1;
    end
    if (out_ready & out_valid) count <= count + 1;
    if (rst) begin valid <= 0; count <= 0; end
  end
endmodule
"""
BORDER = Border(
    source=Stream(
        valid="in_valid", ready="in_ready", payload=(("in_a", 16), ("in_b", 16), ("in_p.wide", 70))
    ),
    sink=Stream(
        valid="out_valid",
        ready="out_ready",
        payload=(("out_product", 32), ("out_wide", 70), ("out_count", 8)),
    ),
)


@pytest.fixture(scope="module")
def library():
    return build_library(VERILOG, "top", BORDER)


def tokens_of(count: int, seed: int) -> np.ndarray:
    tokens = np.random.default_rng(seed).integers(0, 2**64, (count, 4), np.uint64, endpoint=False)
    tokens[:, 0:2] &= np.uint64(0xFFFF)
    tokens[:, 3] &= np.uint64(0x3F)
    return tokens


def expected(tokens: np.ndarray) -> np.ndarray:
    a, b = (tokens[:, k].astype(np.uint16).astype(np.int16).astype(np.int64) for k in (0, 1))
    product = (a * b) & 0xFFFFFFFF
    return np.stack([product.astype(np.uint64), tokens[:, 2], tokens[:, 3]], axis=1)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 2**32),
    source=st.sampled_from([0.0, 0.1, 0.9]),
    sink=st.sampled_from([0.0, 0.1, 0.9]),
)
def test_stalls_on_either_side_change_no_result(library, seed, source, sink):
    tokens = tokens_of(300, seed)
    with Simulation(library, BORDER) as simulation:
        trace = simulation.run(tokens, 300, Stalls(seed=seed, source=source, sink=sink))
    assert np.array_equal(trace.outputs[:, :3], expected(tokens))
    assert np.array_equal(trace.outputs[:, 3], np.arange(300) % 256)
    assert (np.diff(trace.accepted_at) > 0).all()
    assert (trace.produced_at - trace.accepted_at >= 3).all()


def test_without_stalls_one_token_passes_each_cycle_after_the_latency(library):
    with Simulation(library, BORDER) as simulation:
        trace = simulation.run(tokens_of(100, 0), 100)
    assert set(trace.produced_at - trace.accepted_at) == {3}
    assert trace.cycles == 103


def test_stalls_come_as_often_as_asked(library):
    with Simulation(library, BORDER) as simulation:
        trace = simulation.run(tokens_of(5000, 0), 5000, Stalls(seed=1, source=0.5))
    assert trace.cycles == pytest.approx(10_000, rel=0.05)


def test_the_state_lasts_from_run_to_run_and_a_new_simulation_starts_afresh(library):
    tokens = tokens_of(20, 0)
    for _ in range(2):
        with Simulation(library, BORDER) as simulation:
            counts = [simulation.run(part, 10).outputs[:, 3] for part in (tokens[:10], tokens[10:])]
        assert np.array_equal(np.concatenate(counts), np.arange(20))


def test_a_design_that_gives_fewer_results_than_expected_is_reported_as_stuck(library):
    with (
        Simulation(library, BORDER) as simulation,
        pytest.raises(
            VerificationError, match=r"nothing moved for 50 cycles .*5 of 5 tokens accepted and 5 of 6"
        ),
    ):
        simulation.run(tokens_of(5, 0), 6, patience=50)


def test_a_second_build_is_found_in_the_cache(library):
    assert build_library(VERILOG, "top", BORDER) == library


def test_a_failing_compiler_shows_its_own_error_line(own_cache, fake_tool, monkeypatch):
    tool = fake_tool("import sys; print('x.cc:1:1: error: no such thing'); sys.exit(1)", "compiler")
    monkeypatch.setenv("CXX", tool.command[0])
    with pytest.raises(ToolError, match=r"x\.cc:1:1: error: no such thing \(log: "):
        build_library(VERILOG, "top", BORDER)


def test_a_compiler_of_the_environment_that_makes_nothing_is_named(own_cache, fake_tool, monkeypatch):
    monkeypatch.setenv("CXX", f"{fake_tool('', 'compiler').command[0]} -fast")
    message = r"^C\+\+ compiler \(CXX = .* -fast.*\) ended well but wrote no simulator.so"
    with pytest.raises(ToolError, match=message):
        build_library(VERILOG, "top", BORDER)


def test_without_a_compiler_the_error_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("kalmanhdl.toolchain.compiler.find_spec", lambda name: None)
    with pytest.raises(ToolError, match=r"no C\+\+ compiler .*install .*ziglang"):
        build_library(VERILOG, "top", BORDER)


# A row of a divider: the divisor is added or subtracted as a sign says.
ROW = """
module top(input clk, input rst, input in_valid, output in_ready, input [69:0] in_a, in_b,
  output out_valid, input out_ready, output [69:0] out_rest);
  reg valid = 0; reg [69:0] a, b;
  wire go = out_ready | ~valid;
  assign in_ready = go, out_valid = valid, out_rest = a + (b ^ {COPIES});
  always @(posedge clk) begin
    if (go) begin valid <= in_valid; a <= in_a; b <= in_b; end
    if (rst) valid <= 0;
  end
endmodule
""".replace("COPIES", ", ".join(["~a[69]"] * 70))


def test_a_bit_that_is_inverted_and_repeated_is_translated_short_and_right(own_cache):
    wide = (("in_a", 70), ("in_b", 70))
    border = Border(
        source=Stream(valid="in_valid", ready="in_ready", payload=wide),
        sink=Stream(valid="out_valid", ready="out_ready", payload=(("out_rest", 70),)),
    )
    assert _COPIES.search(_translated(ROW, "top"))
    tokens = np.random.default_rng(1).integers(0, 2**64, (50, 4), np.uint64, endpoint=False)
    tokens[:, 1::2] &= np.uint64(0x3F)
    with Simulation(build_library(ROW, "top", border, optimised=False), border) as simulation:
        seen = simulation.run(tokens, 50).outputs
    for (a_low, a_high, b_low, b_high), (low, high) in zip(tokens.tolist(), seen.tolist(), strict=True):
        a, b, ones = a_high << 64 | a_low, b_high << 64 | b_low, (1 << 70) - 1
        assert high << 64 | low == (a + (b if a >> 69 else b ^ ones)) & ones
