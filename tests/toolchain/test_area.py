import pytest

from kalmanhdl.errors import DesignError
from kalmanhdl.toolchain.area import area

SUBTRACT = (
    "module top(input clk, input [15:0] a, b, output reg [15:0] q);"
    "always @(posedge clk) q <= a - b; endmodule"
)
MULTIPLY = (
    "module top(input clk, input signed [15:0] a, b, output reg signed [31:0] q);"
    "always @(posedge clk) q <= a * b; endmodule"
)


def test_an_unknown_family_names_those_that_exist():
    with pytest.raises(DesignError, match="unknown family 'xc9'; there are lut4, xc4v, xc5v, xc6v"):
        area(SUBTRACT, "top", "xc9")


@pytest.mark.slow
def test_a_subtraction_takes_one_logic_element_a_bit():
    found = area(SUBTRACT, "top", "lut4")
    assert (found.luts, found.carry, found.ffs) == (16, 16, 16)


@pytest.mark.slow
def test_a_small_multiplication_is_one_block_on_virtex():
    found = area(MULTIPLY, "top", "xc5v")
    assert (found.multipliers, found.luts) == (1, 0)


@pytest.mark.slow
def test_without_blocks_a_multiplication_is_logic():
    found = area(MULTIPLY, "top", "lut4")
    assert found.multipliers == 0
    assert found.luts > 16 * 16
