"""What a compiled filter is written as: its program, the core's Verilog, and a test bench with its data."""

from collections.abc import Mapping, Sequence
from importlib.resources import files

import numpy as np

from kalmanhdl.algorithm import Algorithm
from kalmanhdl.model.model import Array
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import compiled, rows_read, source, tokens
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.program import image, listing
from kalmanhdl.processor.verilog import TOP, core_verilog
from kalmanhdl.simulate.commands import commands, started
from kalmanhdl.simulate.reference import reference
from kalmanhdl.testbench.core_file import capi2, copied, lint, target


def contents(filter_: Traced, core: Core, z: Array | None = None) -> Mapping[str, str]:
    """The files by name. z (steps, m), NaN where missed: what the test bench feeds.

    With it, ``input.txt`` and ``expected.txt`` hold the same numbers as reals, a row a line, constants first;
    a Makefile and a FuseSoC core run the test bench.
    Raises ProgramError where the filter does not fit the core, ToolError.
    """
    program = compiled(filter_, core)
    found = {
        "program.asm": source(filter_, core),
        "program.hex": image(program),
        "program.lst": listing(program),
        "core.v": core_verilog(core),
    }
    if z is None:
        return found
    rows = rows_read(core, z)
    engine = Engine(filter_, core)
    sent = [engine.step(row) for row in rows]
    read = tokens(filter_, core, rows)
    outputs = [number for row in sent for number in row]
    sizes = {
        "WIDTH": core.form.width,
        "PROGRAM_WORDS": len(program.words),
        "INPUTS": len(read),
        "OUTPUTS": len(outputs),
    }
    shipped = files("kalmanhdl.processor")
    body = shipped.joinpath("testbench.v").read_text(encoding="utf-8")
    found["testbench.v"] = "".join(f"`define {name} {size}\n" for name, size in sizes.items()) + body
    found["Makefile"] = shipped.joinpath("testbench.mk").read_text(encoding="utf-8")
    found["program.core"] = _description()
    found["input.hex"], found["expected.hex"] = _hexadecimal(read, core), _hexadecimal(outputs, core)
    constants = read[: len(read) - sum(map(len, rows))]
    found["input.txt"] = _reals([constants, *rows], core)
    found["expected.txt"] = _reals(sent, core)
    return found


def off_reference(filter_: Traced, algorithm: Algorithm, core: Core, z: Array) -> Array:
    """How far the estimates are from those in double precision at most, in the model's units. Shape (n,)."""
    model, cube = filter_.model, z[:, None]
    issued = commands(model, cube, np.ones(cube.shape[:2], bool))
    exact = reference(algorithm(model), issued, cube, np.zeros((len(z), 1, 0))).x[:, 0]
    engine = Engine(filter_, core)
    sent = np.array([engine.step(row) for row in rows_read(core, z)], float)
    found = sent[:, : model.n] * float(core.form.resolution)
    running = started(model, issued)[:, 0]
    return np.asarray(np.abs(found - exact)[running].max(axis=0, initial=0.0))


def _description() -> str:
    """The FuseSoC core of the folder: its target ``sim`` runs the test bench in Icarus."""
    images = [f"{name}.hex" for name in ("program", "input", "expected")]
    return capi2(
        {
            "name": "kalmanhdl:processor:program:0",
            "description": "A matrix processor, its program and their test bench, made by kalmanhdl",
            "filesets": {
                "rtl": {"files": ["core.v"], "file_type": "verilogSource"},
                "bench": {"files": ["testbench.v"], "file_type": "verilogSource"},
                "images": copied(images),
            },
            "targets": {
                "default": {"filesets": ["rtl"], "toplevel": TOP},
                "lint": lint(TOP),
                "sim": target("testbench", ["rtl", "bench", "images"], "sim", {"tool": "icarus"}),
            },
        }
    )


def _hexadecimal(numbers: Sequence[int], core: Core) -> str:
    digits, mask = -(-core.form.width // 4), (1 << core.form.width) - 1
    return "".join(f"{number & mask:0{digits}X}\n" for number in numbers)


def _reals(rows: Sequence[Sequence[int]], core: Core) -> str:
    # A raw number of at most 32 bits is a double.
    return "".join(" ".join(repr(float(core.form.real(raw))) for raw in row) + "\n" for row in rows)
