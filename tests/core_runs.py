"""Arithmetic cores compiled by CXXRTL, side by side, and run on arrays of raw integers."""

import ctypes

import numpy as np
from amaranth.hdl import Module
from amaranth.lib.wiring import Component, In, Out

from kalmanhdl.rtl.verilog import to_rtlil
from kalmanhdl.toolchain.cxxrtl import compile_simulator, mangled
from kalmanhdl.toolchain.yosys import rtlil_to_verilog

_HARNESS = """
#include "design.cc"
#include "ports.h"
extern "C" __attribute__((visibility("default")))
void run_vectors(const uint64_t *in, uint64_t *out, size_t count, size_t clocks)
{
    cxxrtl_design::p_top top;
    for (size_t k = 0; k < clocks; k++) {
        const uint64_t *vector = in + (k < count ? k : count - 1) * INPUTS;
        uint64_t *results = out + k * OUTPUTS;
        PUT
        CLOCK(0) top.step();
        GET
        CLOCK(1) top.step();
    }
}
"""


class _Side(Component):
    """Cores with operands from the same ports, each with a port for its result."""

    def __init__(self, cores) -> None:
        self.cores = cores
        self.operands = {
            name: len(getattr(core, name))
            for core in cores.values()
            for name in ("a", "b", "c")
            if hasattr(core, name)
        }
        results = {name: Out(len(core.result)) for name, core in cores.items()}
        super().__init__({name: In(width) for name, width in self.operands.items()} | results)

    def elaborate(self, platform):
        m = Module()
        for name, core in self.cores.items():
            m.submodules[f"core_{name}"] = core
            given = [operand for operand in self.operands if hasattr(core, operand)]
            m.d.comb += [getattr(core, operand).eq(getattr(self, operand)) for operand in given]
            m.d.comb += getattr(self, name).eq(core.result)
        return m


class CompiledCores:
    """Cores by name, with ports ``a``, ``b``, ``c`` and ``result`` of up to 64 bits, ready to run."""

    def __init__(self, cores, *, optimised=False) -> None:
        self._side = side = _Side(cores)
        verilog = rtlil_to_verilog(to_rtlil(side, "top"), "top")
        puts = (f"top.{mangled(n)}.set<uint64_t>(vector[{k}]);" for k, n in enumerate(side.operands))
        gets = (f"results[{k}] = top.{mangled(n)}.get<uint64_t>();" for k, n in enumerate(side.cores))
        clock = f"top.{mangled('clk')}.set<bool>(x);" if "input clk" in verilog else ""
        macros = {"PUT": " ".join(puts), "GET": " ".join(gets), "CLOCK(x)": clock}
        macros |= {"INPUTS": len(side.operands), "OUTPUTS": len(side.cores)}
        ports = "".join(f"#define {name} {value}\n" for name, value in macros.items())
        library = compile_simulator(verilog, "top", ports, _HARNESS, optimised=optimised)
        self._run = ctypes.CDLL(str(library)).run_vectors

    def results(self, *operands):
        """The result of every core, as arrays of unsigned raw integers, for arrays of operands a, b, c."""
        side = self._side
        vectors = np.stack([np.asarray(o).astype(np.uint64) for o in operands], axis=1)
        vectors = np.ascontiguousarray(vectors[:, : len(side.operands)])
        count = len(vectors)
        clocks = count + max(core.registers for core in side.cores.values())
        out = np.zeros((clocks, len(side.cores)), np.uint64)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (vectors, out)]
        self._run(*pointers, ctypes.c_size_t(count), ctypes.c_size_t(clocks))
        return {
            name: out[core.registers : core.registers + count, k]
            for k, (name, core) in enumerate(side.cores.items())
        }
