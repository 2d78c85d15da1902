"""What the papers print, as data beside the code."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def facts(paper: str) -> dict[str, Any]:
    """The facts of a paper's file."""
    return tomllib.loads(files(__package__).joinpath(f"{paper}.toml").read_text(encoding="utf-8"))
