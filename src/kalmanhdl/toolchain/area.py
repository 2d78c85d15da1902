"""Synthesis figures: how many cells a design takes on a family that Yosys has no place and route for."""

import json
import tomllib
from dataclasses import dataclass
from functools import cache as remembered
from importlib.resources import files
from typing import Any

from kalmanhdl.errors import DesignError
from kalmanhdl.toolchain.yosys import cached_script
from kalmanhdl.toolchain.yowasp import YOSYS, version


@dataclass(frozen=True, slots=True, kw_only=True)
class AreaFigures:
    """Cells after synthesis, before placement. Not to be called an implementation.

    ``luts`` includes those that serve as memory or shift register, ``carry`` counts bits of carry chain,
    ``block_rams`` counts blocks of 18 kbit, ``cells`` all cells by type.
    """

    family: str
    family_name: str
    tool: str
    luts: int
    carry: int
    ffs: int
    multipliers: int
    block_rams: int
    cells: dict[str, int]


def area(verilog: str, top: str, family: str) -> AreaFigures:
    """Synthesise for a family (``xc4v``, ``xc5v``, ``xc6v``, ``lut4``) and count.

    ``lut4`` has multipliers and memories in logic. Raises DesignError for an unknown family, ToolError.
    """
    facts = _facts()
    families = sorted(name for name in facts if name != "cells")
    if family not in families:
        raise DesignError(f"area: unknown family {family!r}; there are {', '.join(families)}")
    synthesis = facts[family]["synthesis"].format(top=top).strip().splitlines()
    inputs = {"design.v": verilog, "logic_element.v": _text("logic_element.v")}
    commands = ["read_verilog design.v", *synthesis, "tee -q -o statistics.json stat -json"]
    statistics = json.loads(cached_script("area", commands, inputs, "statistics.json"))
    cells: dict[str, int] = statistics["design"]["num_cells_by_type"]

    def count(kind: str) -> int:
        return sum(number * facts["cells"][kind].get(cell, 0) for cell, number in cells.items())

    return AreaFigures(
        family=family,
        family_name=facts[family]["name"],
        tool=version(YOSYS),
        luts=count("luts"),
        carry=count("carry"),
        ffs=count("ffs"),
        multipliers=count("multipliers"),
        block_rams=count("block_rams"),
        cells=cells,
    )


@remembered
def _facts() -> dict[str, Any]:
    return tomllib.loads(_text("families.toml"))


def _text(name: str) -> str:
    return files(__package__).joinpath(name).read_text()
