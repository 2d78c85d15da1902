"""The FuseSoC description of a build's folder, in its format CAPI2."""

from collections.abc import Iterable
from typing import Any

# Yosys writes operands of other widths than their operator, and wires that nothing reads.
LINT_WAIVED = ("WIDTH", "UNUSED", "UNOPTFLAT", "DECLFILENAME")
VERILATOR = ("--flatten", "-Wno-fatal", "-Wno-lint", "-Wno-style")
VERILATOR_COMPILER = ("-std=c++17", "-DVL_USER_FATAL")


def core_file(name: str, bench: Iterable[str]) -> str:
    """The core of a design: its Verilog, and the files of its test bench, paths in the build's folder."""
    import yaml

    text = yaml.safe_dump(_core(name, sorted(bench)), sort_keys=False, width=100)
    return f"CAPI=2:\n{text}"


def _core(name: str, bench: list[str]) -> dict[str, Any]:
    sources = [path for path in bench if path.endswith(".cpp")]
    headers = [path for path in bench if path.endswith(".h")]
    others = [path for path in bench if path not in {*sources, *headers}]
    compiled = {
        "files": [*sources, *({path: {"is_include_file": True}} for path in headers)],
        "file_type": "cppSource",
    }
    return {
        "name": f"kalmanhdl:filters:{name}:0",
        "description": "A Kalman filter and its test bench, made by kalmanhdl",
        "filesets": {
            "rtl": {"files": [f"{name}.v"], "file_type": "verilogSource"},
            "vectors": _copied(others),
            "compiled": compiled,
            # cocotb's own makefile compiles the design again.
            "design": _copied([f"{name}.v"]),
        },
        "targets": {
            "default": {"filesets": ["rtl"], "toplevel": name},
            "lint": {
                "filesets": ["rtl"],
                "toplevel": name,
                "flow": "lint",
                "flow_options": {
                    "tool": "verilator",
                    "verilator_options": ["-Wall", *(f"-Wno-{one}" for one in LINT_WAIVED)],
                },
            },
            "sim": {
                "description": "The vectors in Verilator",
                "filesets": ["rtl", "vectors", "compiled"],
                "toplevel": name,
                "flow": "sim",
                "flow_options": {
                    "tool": "verilator",
                    "verilator_options": [
                        *VERILATOR,
                        f'-CFLAGS "{" ".join(VERILATOR_COMPILER)}"',
                    ],
                    "run_options": ["testbench"],
                },
            },
            "cocotb": {
                "description": "The vectors in Icarus Verilog, by cocotb",
                "filesets": ["rtl", "vectors", "design"],
                "toplevel": name,
                "flow": "sim",
                "flow_options": {"tool": "icarus"},
                # Of the hooks of a run edalize 0.6 calls the one before it only.
                "hooks": {"pre_run": ["cocotb"]},
            },
        },
        "scripts": {"cocotb": {"cmd": ["make", "-C", "testbench", f"TOP={name}", "icarus"]}},
    }


def _copied(paths: list[str]) -> dict[str, Any]:
    """Files that keep their paths where FuseSoC works."""
    return {"files": [{path: {"copyto": path}} for path in paths], "file_type": "user"}
