"""The page of a processor's program has its sections, with data and without."""

import re

import numpy as np
import pytest
from builds import placement

from kalmanhdl.design_file import loads
from kalmanhdl.processor.build import Built
from kalmanhdl.processor.checks import Checked
from kalmanhdl.processor.fit import fitted
from kalmanhdl.processor.follow import follow
from kalmanhdl.processor.step import step_of
from kalmanhdl.report.processor_document import processor_document
from kalmanhdl.report.processor_page import processor_page
from kalmanhdl.report.writer import json_text, write_processor_report
from kalmanhdl.simulate.data import plots_from_arrays

ALTITUDE = """
name = "altitude"
[model]
kind = "constant_velocity"
axes = ["up"]
T = 1.0
noise = 0.5
R = [[9.0]]
[model.initial]
kind = "two_point"
[architecture]
kind = "processor"
"""


@pytest.fixture(scope="module")
def fit():
    return fitted(loads(ALTITUDE))


@pytest.fixture(scope="module")
def whole(fit):
    z = np.cumsum(np.random.default_rng(1).normal(size=(40, 2, 1)), axis=0)
    z[7, 0] = np.nan
    run = Checked(simulator="cxxrtl", peripherals="prompt", steps=80, outputs=320, values=9000, clocks=3500)
    return Built(
        fit=fit,
        files={},
        step=step_of(fit),
        followed=follow(
            fit.filter_,
            fit.core,
            fit.given,
            fit.design.algorithm,
            fit.scaling,
            plots_from_arrays(z, fit.given),
        ),
        checked=(run,),
        placed=(placement(2, 62.5), placement(1, 60.0)),
        seconds={"rtl": 1.0},
    )


def headings(text):
    return re.findall(r"<h2>([^<]*)</h2>", text.partition("</section>")[2])


def test_every_section_of_a_whole_build_is_there(whole):
    text = processor_page(whole, processor_document(whole))
    assert headings(text) == [
        *("Estimate", "States", "Accuracy", "Convergence", "Quantisation error"),
        *("Core", "Step", "Program", "Verification", "Implementation"),
    ]
    assert "update: 1 / S" in text
    assert "In 0 rows a result did not fit" in text
    assert not re.search(r"<(?:script|img|iframe|link)\b[^>]*\s(?:src|href)\s*=\s*(?![\"']?data:)", text)


def test_a_build_without_data_or_tools_says_so(fit):
    bare = Built(fit=fit, files={}, step=step_of(fit))
    text = processor_page(bare, processor_document(bare))
    assert headings(text) == ["Accuracy", "Core", "Step", "Program", "Verification", "Implementation"]
    for absent in ("the build had no data", "was not compared", "Not placed and routed"):
        assert absent in text


def test_the_document_has_the_figures_of_the_page(whole):
    found = processor_document(whole)
    rate = found["implementation"]["updates_per_second"]
    assert rate == pytest.approx(62.5e6 / found["program"]["clocks_per_step"])
    assert [one["seed"] for one in found["implementation"]["placements"]] == [1, 2]
    assert len(found["step"]) == found["program"]["instructions_per_step"]
    assert found["accuracy"]["saturations"] == 0
    assert max(found["accuracy"]["off_reference"]) < 1e-3
    assert json_text(found)


def test_equal_builds_have_equal_files(whole, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_processor_report(whole, tmp_path / name)
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == {
        "report.json",
        "report.html",
        "estimates.csv",
        "step.png",
        "step.svg",
        "track.png",
        "track.svg",
    }
    # Bokeh numbers its figures through the life of a process.
    for name in names - {"report.html"}:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
