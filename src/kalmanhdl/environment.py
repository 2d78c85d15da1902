"""What environment variables say: compilers (``CC``, ``CXX``), and where results are kept."""

import os
import shlex
import shutil
from pathlib import Path

import platformdirs

from kalmanhdl.errors import ToolError
from kalmanhdl.validation import shown


def compiler_of(variable: str) -> tuple[str, ...] | None:
    """The command that a variable names, in words as a shell splits them; None where it is not set.

    Raises ToolError for what is no command, or not there.
    """
    text = os.environ.get(variable)
    if not text:
        return None
    try:
        words = shlex.split(text)
    except ValueError:
        raise ToolError(_problem(variable, text, "has a quote that is not closed")) from None
    if not words:
        raise ToolError(_problem(variable, text, "names no program"))
    if shutil.which(words[0]) is None:
        raise ToolError(_problem(variable, text, f"there is no program {shown(words[0])}"))
    return tuple(words)


def _problem(variable: str, text: str, problem: str) -> str:
    return f"{variable} = {shown(text)}: {problem}: name a compiler, or unset {variable}"


def cache_folder(part: str) -> Path:
    """A folder of kept results, made if it is not there: in the user's cache folder, or ``KALMANHDL_CACHE``.

    Raises ToolError where it cannot be made, or not written to.
    """
    root = Path(os.environ.get("KALMANHDL_CACHE") or platformdirs.user_cache_dir("kalmanhdl"))
    folder, problem = root / part, None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        problem = error.strerror
    if problem is None and not os.access(folder, os.W_OK):
        problem = "cannot be written to"
    if problem is not None:
        raise ToolError(f"cache folder {folder}: {problem}: set KALMANHDL_CACHE to another")
    return folder
