"""Programs that the system brings: found on the path, their version asked once."""

import shutil
from functools import cache as remembered

from kalmanhdl.errors import ToolError
from kalmanhdl.toolchain.process import Tool, run, working_folder


def installed(name: str, remedy: str) -> Tool:
    """A program of the system. Raises ToolError, which says what to do, where there is none."""
    path = shutil.which(name)
    if path is None:
        raise ToolError(f"{name} was not found: {remedy}")
    return Tool(name=name, command=(path,), remedy=remedy)


@remembered
def version_line(tool: Tool, argument: str) -> str:
    """The first line of what a program says of its version."""
    with working_folder() as folder:
        output = run(tool, (argument,), folder).output
    return next((line.strip() for line in output.splitlines() if line.strip()), tool.name)
