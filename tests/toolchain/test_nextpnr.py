import dataclasses
import json

import pytest

from kalmanhdl.errors import ToolError
from kalmanhdl.target import device
from kalmanhdl.toolchain.nextpnr import best, parse_report, place_and_route
from kalmanhdl.toolchain.yosys import Netlist, synthesise_ecp5

DEVICE = device("ecp5-25k", 8)


def hop(kind, delay, cell, **more):
    end = {"cell": cell, "loc": [1, 2], "port": "A"}
    return {"type": kind, "delay": delay, "from": end, "to": end, **more}


REPORT = {
    "seconds": 1.5,
    "fmax": {"clk": {"achieved": 250.0, "constraint": 200}, "slow": {"achieved": 200.0, "constraint": 200}},
    "utilization": {
        name: {"used": used, "available": 100}
        for name, used in {"TRELLIS_COMB": 5, "TRELLIS_FF": 6, "MULT18X18D": 7, "DP16KD": 8}.items()
    },
    "critical_paths": [
        {"from": "<async>", "to": "posedge clk", "path": [hop("routing", 9.0, "pad", net="a")]},
        {"from": "posedge clk", "to": "posedge clk", "path": [hop("clk-to-q", 4.0, "x")]},
        {
            "from": "posedge slow",
            "to": "posedge slow",
            "path": [hop("clk-to-q", 0.5, "x"), hop("routing", 4.5, "y", net="innovation[3]")],
        },
    ],
}


def test_figures_are_read_from_the_report():
    found = parse_report(json.dumps(REPORT), DEVICE, 3)
    assert (found.luts, found.ffs, found.multipliers, found.block_rams) == (5, 6, 7, 8)
    assert (found.device, found.grade, found.seed, found.seconds) == ("ecp5-25k", 8, 3, 1.5)
    assert found.fmax_mhz == 200.0


def test_the_critical_path_is_the_slowest_between_registers():
    path = parse_report(json.dumps(REPORT), DEVICE, 3).critical_path
    assert [(one.kind, one.cell, one.net, one.delay_ns) for one in path] == [
        ("clk-to-q", "x", "", 0.5),
        ("routing", "y", "innovation[3]", 4.5),
    ]


def test_a_design_without_registers_is_an_error():
    with pytest.raises(ToolError, match="no path between two registers"):
        parse_report(json.dumps({**REPORT, "fmax": {}}), DEVICE, 3)


def test_the_best_seed_is_the_fastest_and_then_the_lowest():
    one = parse_report(json.dumps(REPORT), DEVICE, 3)
    others = [dataclasses.replace(one, seed=seed, fmax_mhz=mhz) for seed, mhz in ((7, 210.0), (5, 210.0))]
    assert best([one, *others]).seed == 5


def test_a_device_without_place_and_route_says_so():
    netlist = Netlist(top="top", json="{}", cells={}, tool="")
    with pytest.raises(ToolError, match="device unit: there is no place and route"):
        place_and_route(netlist, device("unit", 1), [1], 100)


@pytest.mark.slow
def test_a_small_core_is_placed_and_the_second_call_is_found_in_the_cache(own_cache):
    text = """module top(input clk, input [7:0] a, b, output reg [7:0] q); reg [7:0] x, y;
      always @(posedge clk) begin x <= a; y <= b; q <= x + y; end endmodule"""
    netlist = synthesise_ecp5(text, "top")
    first = place_and_route(netlist, DEVICE, (2, 1), 300)
    assert [one.seed for one in first] == [2, 1]
    assert all(one.ffs == 24 and one.multipliers == 0 and one.fmax_mhz > 150 for one in first)
    total = sum(one.delay_ns for one in first[0].critical_path)
    assert total == pytest.approx(1000 / first[0].fmax_mhz, rel=0.01)
    # Seconds are measured anew unless the result was found.
    assert place_and_route(netlist, DEVICE, (2, 1), 300) == first
