# The part of the Makefile that needs cocotb.
TOPLEVEL_LANG := verilog
SIM ?= icarus
VERILOG_SOURCES := ../$(TOP).v
COCOTB_TOPLEVEL := $(TOP)
COCOTB_TEST_MODULES := bench
SIM_BUILD := $(WORK)/$(SIM)
COCOTB_RESULTS_FILE := $(WORK)/results.xml

MAKEFILES := $(shell cocotb-config --makefiles)
ifeq ($(MAKEFILES),)
$(error cocotb was not found: pip install "cocotb>=2")
endif
include $(MAKEFILES)/Makefile.sim
