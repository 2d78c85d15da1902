"""What environment variables may say, and the message for what they may not."""

import os
import re
import sys

import pytest

from kalmanhdl.environment import cache_folder, compiler_of
from kalmanhdl.errors import ToolError
from kalmanhdl.simulate import compiler as of_c
from kalmanhdl.toolchain import compiler as of_cpp

VARIABLES = {"CC": of_c.find_compiler, "CXX": of_cpp.find_compiler}
WRONG = {
    "   ": "names no program",
    'g++ "x': "has a quote that is not closed",
    "nonsense -O2": "there is no program 'nonsense'",
}


@pytest.mark.parametrize("variable", VARIABLES)
@pytest.mark.parametrize("text", WRONG)
def test_a_variable_that_names_no_compiler_is_shown_with_its_value(variable, text, monkeypatch):
    monkeypatch.setenv(variable, text)
    message = f"{variable} = {text!r}: {WRONG[text]}: name a compiler, or unset {variable}"
    with pytest.raises(ToolError, match=f"^{re.escape(message)}$"):
        VARIABLES[variable]()


def test_a_command_is_split_as_a_shell_does(monkeypatch):
    monkeypatch.setenv("CC", f"'{sys.executable}' '-D A=1'")
    assert compiler_of("CC") == (sys.executable, "-D A=1")
    monkeypatch.setenv("CC", "")
    assert compiler_of("CC") is None


def test_a_cache_that_cannot_be_made_or_written_is_named(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    message = r"^cache folder {}: .*: set KALMANHDL_CACHE to another$"
    monkeypatch.setenv("KALMANHDL_CACHE", str(tmp_path / "file"))
    with pytest.raises(ToolError, match=message.format(re.escape(str(tmp_path / "file/entries")))):
        cache_folder("entries")
    monkeypatch.setenv("KALMANHDL_CACHE", str(tmp_path))
    assert cache_folder("entries") == tmp_path / "entries"
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(ToolError, match=message.format(re.escape(str(tmp_path / "entries")))):
        cache_folder("entries")
