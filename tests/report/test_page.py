"""The page: whole in one file, safe against what names hold, and there for any design."""

import re
from dataclasses import replace

import pytest
from builds import record_of

from kalmanhdl.report.document import document
from kalmanhdl.report.page import page
from kalmanhdl.report.pictures import save_track
from kalmanhdl.report.writer import write_report


@pytest.fixture(scope="module")
def text(radar) -> str:
    return page(radar, document(radar))


def test_nothing_is_loaded_from_anywhere(text):
    assert not re.search(
        r"<(?:script|img|iframe|link|source)\b[^>]*\s(?:src|href)\s*=\s*(?![\"']?data:)", text
    )
    own = re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"https?://|@import|url\(", own)


def test_every_section_of_a_whole_build_is_there(text):
    headings = re.findall(r"<h2>([^<]*)</h2>", text)
    wanted = ["Track", "States", "Accuracy", "Innovations", "Convergence", "Quantisation error"]
    wanted += [
        "Schedule",
        "Operations",
        "Formats",
        "Verification",
        "Implementation",
        "Area on other families",
    ]
    assert [heading for heading in headings if heading in wanted] == wanted
    assert "Synthesis figures" in text


def test_names_of_cells_are_text_and_never_markup(text):
    assert "&lt;add &amp; carry&gt;" in text
    assert "<add & carry>" not in text


def test_names_of_tracks_cannot_leave_their_place(radar):
    tracks = ("</script><script>alert(1)</script>", *radar.simulation.plots.tracks[1:])
    plots = replace(radar.simulation.plots, tracks=tracks)
    hostile = replace(radar, simulation=replace(radar.simulation, plots=plots))
    assert "<script>alert(1)" not in page(hostile, document(hostile))


def test_a_build_without_data_or_placement_says_so(lee):
    text = page(lee, document(lee))
    assert "Not placed and routed in this build" in text
    assert "Beside the paper" in text
    assert "Not measured: the build had no data" in text
    assert document(lee)["accuracy"]["not_measured"] == "the build had no data: see --data"


def test_a_report_is_plain_files_in_a_folder(nile, tmp_path):
    write_report(nile, tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"report.json", "report.html", "estimates.csv", "schedule.svg", "schedule.png",
                     "track.svg", "track.png"}  # fmt: skip


def test_pictures_are_equal_for_equal_builds(nile, tmp_path):
    for name in ("a.svg", "b.svg"):
        save_track(nile.hardware.design.model, "nile", nile.simulation, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_a_nonlinear_model_has_its_page_without_what_needs_matrices(tmp_path):
    record = record_of("ekf_radar", "autoferry_radar_plane.csv")
    made = page(record, document(record))
    assert "the bit-exact estimate beside the truth." in " ".join(made.split())
    assert "Innovations" in made
    assert "The gains are those" not in made
    assert "Two-point differencing" in made
    save_track(record.hardware.design.model, "radar", record.simulation, tmp_path / "track.png")
    assert (tmp_path / "track.png").stat().st_size > 1000
