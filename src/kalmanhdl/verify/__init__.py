"""The Verilog that the user gets, held against the bit-exact engine."""
