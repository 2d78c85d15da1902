"""Work in a thread beside other work ends with it."""

import sys
import time

import pytest

from kalmanhdl.errors import ToolError
from kalmanhdl.toolchain.process import Tool, in_background, run

SLEEP = Tool(name="sleep", command=(sys.executable, "-c", "import time; time.sleep(60)"), remedy="")


def test_its_result_is_there_afterwards():
    with in_background() as start:
        work = start(pow, 2, 10)
    assert work.result() == 1024


def test_its_tools_are_killed_where_the_block_fails(tmp_path):
    begin, works = time.monotonic(), []

    def fail():
        with in_background() as start:
            works.append(start(run, SLEEP, (), tmp_path))
            time.sleep(0.5)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert time.monotonic() - begin < 10
    assert isinstance(works[0].exception(), ToolError)


def test_tools_run_again_after_a_failure(tmp_path):
    test_its_tools_are_killed_where_the_block_fails(tmp_path)
    assert run(Tool(name="true", command=(sys.executable, "-c", ""), remedy=""), (), tmp_path).output == ""
