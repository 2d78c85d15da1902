"""Design files: TOML to ``Design`` and back."""

from kalmanhdl.design_file.reader import load, loads
from kalmanhdl.design_file.writer import dump, dumps

__all__ = ["dump", "dumps", "load", "loads"]
