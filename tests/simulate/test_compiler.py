"""Finding and running a C compiler."""

import os
import sys

import pytest

from kalmanhdl.environment import cache_folder
from kalmanhdl.errors import ToolError
from kalmanhdl.simulate.compiler import find_compiler, shared_library

SOURCE = "int answer(void) { return 42; }"


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("KALMANHDL_CACHE", str(tmp_path))


def test_a_library_is_compiled_once():
    command = find_compiler()
    assert command
    path = shared_library(SOURCE, command)
    made = path.stat().st_mtime_ns
    assert shared_library(SOURCE, command) == path
    assert path.stat().st_mtime_ns == made
    assert os.listdir(cache_folder("engine")) == [path.name]


def test_a_compiler_that_fails_is_quoted():
    command = find_compiler()
    assert command
    with pytest.raises(ToolError, match=r"error: .*nonsense"):
        shared_library("nonsense answer(void);", command)


def test_a_compiler_that_cannot_be_run_is_named(tmp_path):
    with pytest.raises(ToolError, match="no_such_compiler"):
        shared_library(SOURCE, [str(tmp_path / "no_such_compiler")])


def test_the_environment_chooses_the_compiler(monkeypatch):
    monkeypatch.setenv("CC", f"{sys.executable} -m something")
    assert find_compiler() == (sys.executable, "-m", "something")


def test_a_machine_without_compiler_has_none(monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setattr("kalmanhdl.simulate.compiler.find_spec", lambda name: None)
    assert find_compiler() is None


@pytest.mark.parametrize(
    ("code", "problem"), [(0, r" ended well but wrote no library: .* CC"), (1, ": exit code 1")]
)
def test_a_compiler_of_the_environment_that_makes_nothing_is_named(monkeypatch, tmp_path, code, problem):
    # Messages cut long values short, and an interpreter's path is as long as its place makes it.
    (tmp_path / "python").symlink_to(sys.executable)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setenv("CC", f"python -c 'raise SystemExit({code})'")
    command = find_compiler()
    assert command
    with pytest.raises(ToolError, match=rf"^C compiler \(CC = .*python.*\){problem}$"):
        shared_library(SOURCE, command)
