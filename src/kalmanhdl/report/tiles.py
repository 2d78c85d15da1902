"""The few figures of a build that matter most, in one row on top of its page."""

from dataclasses import dataclass
from typing import Any

from kalmanhdl.report.wording import number, percent, prefixed


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One figure: what it is, its value, and what must be known to read it."""

    title: str
    value: str
    note: str


def tiles(document: dict[str, Any]) -> list[Tile]:
    """The tiles of what ran; an estimate says that it is one."""
    found = [*_speed(document), _area(document), _verification(document), *_accuracy(document)]
    return [tile for tile in found if tile is not None]


def _speed(document: dict[str, Any]) -> list[Tile]:
    placed, schedule = document["implementation"], document["schedule"]
    figures = placed if placed["fmax_mhz"] is not None else document["estimates"]
    origin = (
        f"best of {len(placed['placements'])} placements" if figures is placed else "estimate, not placed"
    )
    interval, channels = schedule["interval_cycles"], schedule["channels"]
    tracks = "one track" if channels == 1 else f"{channels} tracks in turn"
    return [
        Tile(
            title="Updates/s",
            value=prefixed(figures["updates_per_second"], "", 4).strip(),
            note=f"one every {_cycles(interval)}, {tracks}",
        ),
        Tile(title="Clock", value=f"{number(figures['fmax_mhz'])} MHz", note=origin),
        Tile(
            title="Latency",
            value=f"{number(figures['latency_ns'])} ns",
            note=_cycles(schedule["latency_cycles"]),
        ),
    ]


def _cycles(count: int) -> str:
    return "clock cycle" if count == 1 else f"{count} clock cycles"


def _area(document: dict[str, Any]) -> Tile | None:
    placed = document["implementation"]
    if placed["luts"] is None:
        return Tile(
            title="Multiplier blocks",
            value=number(document["schedule"]["multiplier_blocks"]),
            note="planned, not placed",
        )
    return Tile(
        title="Area",
        value=f"{number(placed['luts'])} LUTs",
        note=f"{number(placed['ffs'])} FFs, {placed['multipliers']} multipliers, {placed['block_rams']} RAMs",
    )


def _verification(document: dict[str, Any]) -> Tile | None:
    runs = document["verification"]
    if not runs:
        return None
    bits, wrong = sum(run["bits"] for run in runs), sum(run["mismatches"] for run in runs)
    return Tile(
        title="Bits that differ",
        value=number(wrong),
        note=f"of {prefixed(bits, '', 3).strip()} compared, Verilog and engine",
    )


def _accuracy(document: dict[str, Any]) -> list[Tile]:
    accuracy = document["accuracy"]
    if accuracy["nis_mean"] is None:
        return []
    low, high = accuracy["nis_band_95"]
    found = [
        Tile(
            title="Mean NIS",
            value=number(accuracy["nis_mean"], 3),
            note=f"95 % band {number(low, 3)} to {number(high, 3)}",
        )
    ]
    return found + loss(accuracy)


def loss(accuracy: dict[str, Any]) -> list[Tile]:
    """The largest change of an error against truth from the float reference to the bit-exact filter."""
    pairs = zip(accuracy["rmse_reference"], accuracy["rmse_bitexact"], strict=True)
    losses = [b / a - 1 for a, b in pairs if a and b is not None]
    note = "change of the error against truth, worst state"
    return [Tile(title="Lost to rounding", value=percent(max(losses)), note=note)] if losses else []
