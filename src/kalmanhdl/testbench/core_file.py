"""The FuseSoC description of a build's folder, in its format CAPI2."""

from collections.abc import Iterable
from typing import Any

# Yosys writes operands narrower than their operator, wires that nothing reads, many modules to a file, and
# wires whose bits depend on others of theirs, which Verilator takes for loops.
LINT_WAIVED = ("WIDTH", "UNUSED", "DECLFILENAME", "UNOPTFLAT")
VERILATOR = ("--flatten", "-Wno-fatal", "-Wno-lint", "-Wno-style")
VERILATOR_COMPILER = ("-std=c++17", "-DVL_USER_FATAL")


def core_file(name: str, bench: Iterable[str]) -> str:
    """The core of a design: its Verilog, and the files of its test bench, paths in the build's folder."""
    core = {
        "name": f"kalmanhdl:filters:{name}:0",
        "description": "A Kalman filter and its test bench, made by kalmanhdl",
        "filesets": _filesets(name, sorted(bench)),
        "targets": _targets(name),
        "scripts": {"cocotb": {"cmd": ["make", "-C", "testbench", f"TOP={name}", "icarus"]}},
    }
    return capi2(core)


def capi2(core: dict[str, Any]) -> str:
    """The text of a core."""
    # Takes some hundredths of a second to import.
    import yaml

    text: str = yaml.safe_dump(core, sort_keys=False, width=100)
    return f"CAPI=2:\n{text}"


def lint(top: str) -> dict[str, Any]:
    """A target that has Verilator look at the fileset ``rtl``."""
    options = ["-Wall", *(f"-Wno-{one}" for one in LINT_WAIVED)]
    return target(top, ["rtl"], "lint", {"tool": "verilator", "verilator_options": options})


def copied(paths: Iterable[str]) -> dict[str, Any]:
    """Files that keep their paths where FuseSoC works."""
    return {"files": [{path: {"copyto": path}} for path in paths], "file_type": "user"}


def _filesets(name: str, bench: list[str]) -> dict[str, Any]:
    sources = [path for path in bench if path.endswith(".cpp")]
    headers = [path for path in bench if path.endswith(".h")]
    compiled = [*sources, *({path: {"is_include_file": True}} for path in headers)]
    return {
        "rtl": {"files": [f"{name}.v"], "file_type": "verilogSource"},
        "vectors": copied(path for path in bench if path not in {*sources, *headers}),
        "compiled": {"files": compiled, "file_type": "cppSource"},
        # cocotb's own makefile compiles the design again.
        "design": copied([f"{name}.v"]),
    }


def _targets(name: str) -> dict[str, Any]:
    verilator = [*VERILATOR, f'-CFLAGS "{" ".join(VERILATOR_COMPILER)}"']
    compiled = {"tool": "verilator", "verilator_options": verilator, "run_options": ["testbench"]}
    return {
        "default": {"filesets": ["rtl"], "toplevel": name},
        "lint": lint(name),
        "sim": target(name, ["rtl", "vectors", "compiled"], "sim", compiled),
        "cocotb": {
            **target(name, ["rtl", "vectors", "design"], "sim", {"tool": "icarus"}),
            # Of the hooks of a run edalize 0.6 calls the one before it only.
            "hooks": {"pre_run": ["cocotb"]},
        },
    }


def target(top: str, filesets: list[str], flow: str, options: dict[str, Any]) -> dict[str, Any]:
    return {"filesets": filesets, "toplevel": top, "flow": flow, "flow_options": options}
