"""External programs: Yosys, nextpnr and CXXRTL, each run, parsed and cached."""
