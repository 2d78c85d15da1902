"""The devices that there are, read from the TOML files beside this module."""

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from kalmanhdl.target.device import Device
from kalmanhdl.validation import InvalidValueError, as_integer, shown


def device_names() -> tuple[str, ...]:
    """The names of all devices that can be placed and routed for, in alphabetical order."""
    return tuple(name for name in _files() if _facts(name).get("package"))


def device(name: str, grade: int) -> Device:
    """A part at a speed grade. Raises DesignError, naming what there is, for one that is not known."""
    if not isinstance(name, str) or name not in _files():
        known = ", ".join(device_names())
        raise InvalidValueError("target", "device", f" = {shown(name)} is unknown: there are {known}")
    facts = dict(_facts(name))
    grades = facts.pop("grade")
    speed = as_integer(grade)
    if speed is None or str(speed) not in grades:
        known = ", ".join(sorted(grades))
        problem = f" = {shown(grade)} is unknown: the speed grades of {name} are {known}"
        raise InvalidValueError("target", "grade", problem)
    timing, areas = grades[str(speed)], facts.pop("area")
    return Device(
        grade=speed,
        pipelined_period_ns=float(timing["pipelined_period_ns"]),
        delays={kind: _table(rows) for kind, rows in timing["delays"].items()},
        areas={kind: _table(rows) for kind, rows in areas.items()},
        **facts,
    )


@cache
def _files() -> tuple[str, ...]:
    entries = (entry.name for entry in files(__package__).iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in entries if name.endswith(".toml")))


@cache
def _facts(name: str) -> dict[str, Any]:
    return tomllib.loads(files(__package__).joinpath(f"{name}.toml").read_text())


def _table(rows: list[list[Any]]) -> tuple[tuple[int, float], ...]:
    return tuple(sorted((int(size), float(delay)) for size, delay in rows))
