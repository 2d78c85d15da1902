"""The devices that there are, read from the TOML files beside this module."""

import tomllib
from importlib.resources import files
from typing import Any

from kalmanhdl.errors import DesignError
from kalmanhdl.target.device import Device


def device_names() -> tuple[str, ...]:
    """The names of all devices, in alphabetical order."""
    entries = (entry.name for entry in files(__package__).iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in entries if name.endswith(".toml")))


def device(name: str, grade: int) -> Device:
    """A part at a speed grade. Raises DesignError, naming what there is, for one that is not known."""
    if name not in device_names():
        raise DesignError(f"device: unknown name {name!r}; there are {', '.join(device_names())}")
    facts = tomllib.loads(files(__package__).joinpath(f"{name}.toml").read_text())
    grades = facts.pop("grade")
    if str(grade) not in grades:
        known = ", ".join(sorted(grades))
        raise DesignError(f"device {name}: unknown speed grade {grade}; there are {known}")
    timing = grades[str(grade)]
    return Device(
        grade=grade,
        pipelined_period_ns=float(timing["pipelined_period_ns"]),
        delays={kind: _table(rows) for kind, rows in timing["delays"].items()},
        **facts,
    )


def _table(rows: list[list[Any]]) -> tuple[tuple[int, float], ...]:
    return tuple(sorted((int(size), float(delay)) for size, delay in rows))
