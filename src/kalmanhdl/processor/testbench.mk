# Holds the core against what the engine says that the program puts out.
#   make            both of the following
#   make icarus     in Icarus Verilog
#   make verilator  in Verilator 5 with a compiler of C++20
#   make clean
WORK := work

.PHONY: all icarus verilator clean
all: icarus verilator

icarus: $(WORK)/bench.vvp
	vvp -n $(WORK)/bench.vvp

$(WORK)/bench.vvp: testbench.v core.v
	mkdir -p $(WORK)
	iverilog -g2005 -o $@ testbench.v core.v

verilator: $(WORK)/verilator/Vtestbench
	$(WORK)/verilator/Vtestbench

$(WORK)/verilator/Vtestbench: testbench.v core.v
	mkdir -p $(WORK)
	verilator --binary --timing --top-module testbench --Mdir $(WORK)/verilator --flatten \
		-Wno-fatal -Wno-lint -Wno-style testbench.v core.v

clean:
	rm -rf $(WORK)
