"""Every simulator tells the same of the same design: results, records and the clocks in which they come."""

import shutil

import numpy as np
import pytest
from test_simulation import BORDER, VERILOG, tokens_of

from kalmanhdl.errors import ToolError, VerificationError
from kalmanhdl.toolchain.harness import Border, Stream, Watch
from kalmanhdl.toolchain.simulation import Run, Sent, Stalls
from kalmanhdl.toolchain.simulators import Simulator, need, simulate_with

# Two of the pipelines side by side, with looks into each.
PAIR = (
    VERILOG
    + """
module pair(input clk, input rst, input a_in_valid, b_in_valid, output a_in_ready, b_in_ready,
  input [101:0] a_in, b_in, output a_out_valid, b_out_valid, input a_out_ready, b_out_ready,
  output [109:0] a_out, b_out);
  top lane__0(.clk(clk), .rst(rst), .in_valid(a_in_valid), .in_ready(a_in_ready), .in_a(a_in[31:16]),
    .in_b(a_in[15:0]), .\\in_p.wide (a_in[101:32]), .out_valid(a_out_valid), .out_ready(a_out_ready),
    .out_product(a_out[31:0]), .out_wide(a_out[101:32]), .out_count(a_out[109:102]));
  top lane__1(.clk(clk), .rst(rst), .in_valid(b_in_valid), .in_ready(b_in_ready), .in_a(b_in[31:16]),
    .in_b(b_in[15:0]), .\\in_p.wide (b_in[101:32]), .out_valid(b_out_valid), .out_ready(b_out_ready),
    .out_product(b_out[31:0]), .out_wide(b_out[101:32]), .out_count(b_out[109:102]));
endmodule
"""
).replace("wire go =", "(* keep *) wire go =")
NEEDS = {Simulator.VERILATOR: "verilator", Simulator.ICARUS: "iverilog"}


def stream(prefix: str, way: str, width: int) -> Stream:
    name = f"{prefix}_{way}"
    return Stream(valid=f"{name}_valid", ready=f"{name}_ready", payload=((name, width),))


PAIR_BORDER = Border(
    source=stream("a", "in", 102),
    sink=stream("a", "out", 110),
    further=((stream("b", "in", 102), stream("b", "out", 110)),),
    watches=tuple(
        Watch(enable=f"lane__{k}.go", wires=((f"lane__{k}.stage2", 102), (f"lane__{k}.valid", 3)))
        for k in range(2)
    ),
)


def available(simulator: Simulator) -> None:
    tool = NEEDS.get(simulator)
    if tool and shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")


def traces(simulator: Simulator, verilog: str, top: str, border: Border, runs: list[Run]):
    available(simulator)
    return list(simulate_with(simulator, verilog, top, border, optimised=False).run(border, runs))


def pair_runs() -> list[Run]:
    random = np.random.default_rng(1)
    tokens = random.integers(0, 2**64, (2, 300, 2), np.uint64, endpoint=False) & np.uint64(2**38 - 1)
    stalls = Stalls(seed=3, source=0.4, sink=0.3)
    first = Run(sent=tuple(Sent(tokens=each[:120], results=118) for each in tokens), stalls=stalls)
    second = Run(sent=tuple(Sent(tokens=each[120:], results=182) for each in tokens))
    return [first, second]


@pytest.fixture(scope="module")
def by_cxxrtl():
    return traces(Simulator.CXXRTL, PAIR, "pair", PAIR_BORDER, pair_runs())


@pytest.mark.parametrize("simulator", [Simulator.VERILATOR, Simulator.ICARUS])
def test_two_pairs_of_streams_with_looks_inside_are_the_same_everywhere(simulator, by_cxxrtl):
    others = traces(simulator, PAIR, "pair", PAIR_BORDER, pair_runs())
    for expected, seen in zip(by_cxxrtl, others, strict=True):
        for a, b in zip(expected, seen, strict=True):
            assert a.cycles == b.cycles
            for name in ("outputs", "accepted_at", "produced_at"):
                assert np.array_equal(getattr(a, name), getattr(b, name)), name
            assert all(np.array_equal(x, y) for x, y in zip(a.watched, b.watched, strict=True))
            assert len(a.watched[0]) > 100


@pytest.mark.parametrize("simulator", list(Simulator))
def test_ports_of_any_name_and_width_carry_their_bits(simulator):
    tokens = tokens_of(50, 1)
    run = Run(sent=(Sent(tokens=tokens, results=50),))
    ((trace,),) = traces(simulator, VERILOG, "top", BORDER, [run])
    assert np.array_equal(trace.outputs[:, 1:3], tokens[:, 2:])
    assert np.array_equal(trace.outputs[:, 3], np.arange(50))


@pytest.mark.parametrize("simulator", list(Simulator))
def test_a_design_that_hangs_is_said_so(simulator):
    run = Run(sent=(Sent(tokens=tokens_of(5, 0), results=6),))
    with pytest.raises(VerificationError, match="5 of 5 tokens accepted and 5 of 6"):
        traces(simulator, VERILOG, "top", BORDER, [run])


def test_a_number_without_a_value_is_no_number():
    unknown = VERILOG.replace("count = 0;", "count;").replace("count <= 0;", "")
    run = Run(sent=(Sent(tokens=tokens_of(5, 0), results=5),))
    with pytest.raises(VerificationError, match="out_count has no value in cycle"):
        traces(Simulator.ICARUS, unknown, "top", BORDER, [run])


@pytest.mark.parametrize(("simulator", "tool"), list(NEEDS.items()))
def test_a_simulator_that_is_missing_is_one_clear_message(simulator, tool, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        ToolError, match=rf"{tool} was not found: install .*\(Debian: apt-get install {tool}\)"
    ):
        need((simulator,))


@pytest.mark.parametrize("simulator", [Simulator.VERILATOR, Simulator.ICARUS])
def test_what_a_simulator_does_not_like_is_its_own_error_line(simulator):
    with pytest.raises(ToolError, match=r"(?i)(verilator|iverilog) failed .*syntax error"):
        traces(simulator, VERILOG.replace("assign in_ready", "assign assign"), "top", BORDER, [])
