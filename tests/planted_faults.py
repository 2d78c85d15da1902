"""Faults planted in generated Verilog: one constant, one shift, one sign, or one register changed."""

import random
import re
from collections.abc import Callable
from dataclasses import dataclass

_CONSTANT = re.compile(r"(?<![\[:\w])(\d+)'h([0-9a-f]+)")
_SLICE = re.compile(r"(\w)\[(\d+):(\d+)\]")
_SIGN = re.compile(r"\) ([+-]) (?=\$signed|\()")
_REGISTER = re.compile(r"always @\(posedge clk\) *\n +(\S+ ?) <= ([^;]+);")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A changed Verilog, and what was changed where."""

    kind: str
    line: int
    before: str
    after: str
    verilog: str


def plant(verilog: str, seed: int) -> Fault:
    """One fault, chosen by the seed: the four kinds in turn."""
    chooser = random.Random(seed)
    kind, find = list(_KINDS.items())[seed % len(_KINDS)]
    places = list(find(verilog))
    begin, end, after = chooser.choice(places)(chooser)
    return Fault(
        kind=kind,
        line=verilog[:begin].count("\n") + 1,
        before=verilog[begin:end],
        after=after,
        verilog=verilog[:begin] + after + verilog[end:],
    )


_Change = Callable[[random.Random], tuple[int, int, str]]


def _in_logic(verilog: str, match: re.Match[str]) -> bool:
    """Whether a place is in what is assigned; what registers start with is overwritten at once."""
    line = verilog[verilog.rfind("\n", 0, match.start()) + 1 : match.start()]
    return bool(re.match(r" +assign .* = |.*<= |.*\? ", line))


def _constants(verilog: str) -> list[_Change]:
    def change(match: re.Match[str]) -> _Change:
        def flip(chooser: random.Random) -> tuple[int, int, str]:
            bit = 1 << chooser.randrange(int(match[1]))
            return match.start(), match.end(), f"{match[1]}'h{int(match[2], 16) ^ bit:x}"

        return flip

    return [change(m) for m in _CONSTANT.finditer(verilog) if _in_logic(verilog, m)]


def _shifts(verilog: str) -> list[_Change]:
    def change(match: re.Match[str]) -> _Change:
        def move(_: random.Random) -> tuple[int, int, str]:
            high, low = int(match[2]), int(match[3])
            step = -1 if low else 1
            return match.start(), match.end(), f"{match[1]}[{high + step}:{low + step}]"

        return move

    # A slice from the last bit on can only move up, past the end, where bits are undefined.
    return [
        change(m) for m in _SLICE.finditer(verilog) if _in_logic(verilog, m) and int(m[3]) and m[2] != m[3]
    ]


def _signs(verilog: str) -> list[_Change]:
    def change(match: re.Match[str]) -> _Change:
        return lambda _: (match.start(1), match.end(1), "-" if match[1] == "+" else "+")

    return [change(m) for m in _SIGN.finditer(verilog) if _in_logic(verilog, m)]


def _registers(verilog: str) -> list[_Change]:
    def change(match: re.Match[str]) -> _Change:
        return lambda _: (match.start(), match.end(), f"always @*\n    {match[1]} = {match[2]};")

    return [change(m) for m in _REGISTER.finditer(verilog)]


_KINDS = {"constant": _constants, "shift": _shifts, "sign": _signs, "register": _registers}
