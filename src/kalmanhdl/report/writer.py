"""The files of a report."""

import json
from pathlib import Path
from typing import Any

from kalmanhdl.processor.build import Built
from kalmanhdl.report.document import document
from kalmanhdl.report.estimates import estimates_csv
from kalmanhdl.report.record import Record


def write_report(record: Record, folder: Path) -> dict[str, Any]:
    """Write ``report.json``, ``report.html``, ``schedule.svg``, ``schedule.png`` and, of data,
    ``estimates.csv``, ``track.svg`` and ``track.png`` into a folder that exists; returns the document.
    """
    # Pages and pictures take seconds to import; the JSON alone does not need them.
    from kalmanhdl.report.page import page
    from kalmanhdl.report.pictures import save_schedule, save_track

    found = document(record)
    (folder / "report.json").write_text(json_text(found), encoding="utf-8")
    (folder / "report.html").write_text(page(record, found), encoding="utf-8")
    design, summary = record.hardware.design, record.summary
    for suffix in ("svg", "png"):
        save_schedule(summary, design.name, folder / f"schedule.{suffix}")
        if record.simulation is not None:
            save_track(design.model, design.name, record.simulation, folder / f"track.{suffix}")
    if record.simulation is not None:
        text = estimates_csv(design.model, record.simulation)
        (folder / "estimates.csv").write_text(text, encoding="utf-8")
    return found


def write_processor_report(built: Built, folder: Path) -> None:
    """Write the same of a program, ``step.svg`` and ``step.png`` in place of a schedule's pictures."""
    from kalmanhdl.report.lanes import step_lanes
    from kalmanhdl.report.pictures import save_bars, save_track
    from kalmanhdl.report.processor_document import processor_document
    from kalmanhdl.report.processor_page import processor_page

    found, fit, followed = processor_document(built), built.fit, built.followed
    (folder / "report.json").write_text(json_text(found), encoding="utf-8")
    (folder / "report.html").write_text(processor_page(built, found), encoding="utf-8")
    title = f"{fit.design.name}: a step in {built.step.clocks:g} clock cycles"
    for suffix in ("svg", "png"):
        save_bars(step_lanes(built.step), title, folder / f"step.{suffix}")
        if followed is not None:
            save_track(fit.given, fit.design.name, followed, folder / f"track.{suffix}")
    if followed is not None:
        text = estimates_csv(fit.given, followed)
        (folder / "estimates.csv").write_text(text, encoding="utf-8")


def json_text(found: dict[str, Any]) -> str:
    """The text of ``report.json``. Refuses NaN, which is no JSON."""
    return json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
