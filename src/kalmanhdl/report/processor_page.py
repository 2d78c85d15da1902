"""``report.html`` of a processor's program."""

from typing import Any

from kalmanhdl.processor.build import Built
from kalmanhdl.processor.program import listing
from kalmanhdl.processor.step import UNITS
from kalmanhdl.report.figures import bars_figure
from kalmanhdl.report.lanes import step_lanes
from kalmanhdl.report.page import of_data, rendered
from kalmanhdl.report.processor_document import last_bits
from kalmanhdl.report.tiles import Tile, loss
from kalmanhdl.report.wording import number, prefixed


def processor_page(built: Built, document: dict[str, Any]) -> str:
    """The page of a build; ``document`` is its ``processor_document``."""
    model = built.fit.given
    drawn: dict[str, object] = {"step": bars_figure(step_lanes(built.step), "instruction")}
    if built.followed is not None:
        drawn |= of_data(model, built.followed, last_bits(built.fit))
    more = document | {
        "tiles": _tiles(document),
        "listing": listing(built.fit.program),
        "estimates": None,
        "shares": _shares(built),
    }
    return rendered("processor.html.j2", model, built.followed, drawn, more)


def _shares(built: Built) -> list[dict[str, Any]]:
    """By unit, how many instructions of a step it has, and in how many of its clocks it works."""
    rows = built.step.rows
    found = []
    for unit in UNITS:
        mine = [row for row in rows if row.unit == unit]
        clocks = {clock for row in mine for clock in range(row.first, row.last + 1)}
        if mine:
            found.append({"unit": unit, "instructions": len(mine), "clocks": len(clocks)})
    return found


def _tiles(document: dict[str, Any]) -> list[Tile]:
    placed, program, core = (document[key] for key in ("implementation", "program", "core"))
    found = []
    if placed["fmax_mhz"] is not None:
        origin = f"best of {len(placed['placements'])} placements"
        rate = prefixed(placed["updates_per_second"], "", 4).strip()
        found.append(Tile(title="Updates/s", value=rate, note="one track, one after the other"))
        found.append(Tile(title="Clock", value=f"{number(placed['fmax_mhz'])} MHz", note=origin))
    clocks = number(round(program["clocks_per_step"], 2))
    found.append(
        Tile(
            title="Clocks a step",
            value=clocks,
            note=f"{number(program['instructions_per_step'])} instructions",
        )
    )
    if placed["luts"] is not None:
        note = (
            f"{number(placed['ffs'])} FFs, {placed['multipliers']} multipliers, {placed['block_rams']} RAMs"
        )
        found.append(Tile(title="Area", value=f"{number(placed['luts'])} LUTs", note=note))
    note = f"{number(program['matrices'])} of {core['matrices']} matrices"
    found.append(
        Tile(title="Program", value=f"{program['words']} of {core['program_words']} words", note=note)
    )
    runs = document["verification"]
    if runs:
        values, wrong = (sum(run[key] for run in runs) for key in ("values", "mismatches"))
        note = f"of {prefixed(values, '', 3).strip()} compared, Verilog and simulator"
        found.append(Tile(title="Values that differ", value=number(wrong), note=note))
    return found + loss(document["accuracy"])
