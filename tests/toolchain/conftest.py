"""A cache of its own for every test, and fake programs."""

import stat
import sys
from pathlib import Path

import pytest

from kalmanhdl.toolchain.process import Tool


@pytest.fixture
def own_cache(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("KALMANHDL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def fake_tool(tmp_path):
    """Make an executable of a few lines of Python."""

    def make(code: str, name: str = "fake") -> Tool:
        program = tmp_path / name
        program.write_text(f"#!{sys.executable}\n{code}\n")
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        return Tool(name=name, command=(str(program),), remedy="install it")

    return make
