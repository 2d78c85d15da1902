"""What a compiled filter is written as: its program, the core's Verilog, and a test bench with its data."""

from collections.abc import Sequence
from importlib.resources import files

from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import compiled, source, tokens
from kalmanhdl.processor.compiler.trace import Traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.numbers import shortest
from kalmanhdl.processor.program import Program, image, listing
from kalmanhdl.processor.verilog import TOP, core_verilog
from kalmanhdl.testbench.core_file import capi2, copied, lint, target


def contents(filter_: Traced, core: Core, rows: Sequence[Sequence[int]] | None = None) -> dict[str, str]:
    """The files by name. ``rows``: the raw numbers that the test bench feeds, as ``rows_read`` makes them.

    With them, ``input.txt`` and ``expected.txt`` hold the same numbers as reals, a row a line, constants
    first; a Makefile and a FuseSoC core run the test bench.
    Raises ProgramError where the filter does not fit the core, ToolError.
    """
    program = compiled(filter_, core)
    found = {
        "program.asm": source(filter_, core),
        "program.hex": image(program),
        "program.lst": listing(program),
        "core.v": core_verilog(core),
    }
    return found if rows is None else found | bench_files(filter_, core, program, rows)


def bench_files(
    filter_: Traced, core: Core, program: Program, rows: Sequence[Sequence[int]]
) -> dict[str, str]:
    """The files of the test bench by name; beside them it needs ``core.v`` and ``program.hex``."""
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
    constants = read[: len(read) - sum(map(len, rows))]
    return {
        "testbench.v": "".join(f"`define {name} {size}\n" for name, size in sizes.items()) + body,
        "Makefile": shipped.joinpath("testbench.mk").read_text(encoding="utf-8"),
        "program.core": _description(),
        "input.hex": _hexadecimal(read, core),
        "expected.hex": _hexadecimal(outputs, core),
        "input.txt": _reals([constants, *rows], core),
        "expected.txt": _reals(sent, core),
    }


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
    return "".join(shortest(core.numbers.reals(row)) + "\n" for row in rows)
