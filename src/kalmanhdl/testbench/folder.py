"""What a test bench is written as: files by their paths in the folder of a build."""

from collections.abc import Mapping
from importlib.resources import files

from kalmanhdl.model.model import Model
from kalmanhdl.rtl.interface import Interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.testbench.core_file import core_file
from kalmanhdl.testbench.sections import sections
from kalmanhdl.testbench.tables import tables
from kalmanhdl.testbench.vectors import vectors
from kalmanhdl.toolchain.harness import Border
from kalmanhdl.toolchain.verilator import model_header, ports_header, top_header
from kalmanhdl.verify.border import streams_of

_FOLDER = "testbench"
_SHIPPED = ("Makefile", "README.md", "bench.cpp", "bench.py", "cocotb.mk")


def contents(name: str, model: Model, plan: Plan, shown: Interface, engine: Engine) -> Mapping[str, str]:
    """The test bench of a design called ``name``, with its FuseSoC description, which stands beside it."""
    shipped = files("kalmanhdl.testbench.shipped")
    source, *further = streams_of(shown)
    border = Border(source=source[0], sink=source[1], further=tuple(further))
    found = {
        **{file: shipped.joinpath(file).read_text(encoding="utf-8") for file in _SHIPPED},
        **tables(vectors(plan, shown, engine, sections(model, plan, shown)), plan, shown),
        "model.h": model_header(),
        "pairs.h": ports_header(border),
        "top.h": top_header(f"V{name}"),
    }
    bench = {f"{_FOLDER}/{file}": text for file, text in sorted(found.items())}
    return {**bench, f"{name}.core": core_file(name, bench)}
