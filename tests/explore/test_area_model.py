"""The estimate of area: made of what operators were measured to take."""

from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.explore.area import estimated_luts
from kalmanhdl.explore.format_engine import FormatEngine
from kalmanhdl.explore.program import program_of
from kalmanhdl.explore.tracks import drawn_plots, drive_of, judged
from kalmanhdl.numerics.integers import in_reals
from kalmanhdl.target import device

KINDS = ("add", "select", "round", "clamp", "shift", "leading_one", "table", "multiply", "divide")


@pytest.mark.parametrize("name", ["ecp5-25k", "ecp5-45k", "ecp5-85k"])
def test_every_operator_of_a_part_is_measured_and_grows_with_its_size(name):
    part = device(name, 8)
    assert set(part.areas) == set(KINDS)
    for kind in KINDS:
        luts = [part.area_luts(kind, size) for size, _ in part.areas[kind]]
        assert luts == sorted(luts)
        assert luts[0] > 0


@pytest.mark.parametrize("name", ["lee1997", "dcmkf_radar"])
def test_wider_words_take_more_area(name):
    design = Design.load(f"designs/{name}.toml")
    reals = in_reals(design.model, design.algorithm, design.numerics)
    program, part = program_of(reals.graph, reals.ranges), device("ecp5-25k", 8)
    on = judged(design.model, design.algorithm(design.model), drawn_plots(design.model, 5, 4, 4, 1))
    engine = FormatEngine.of(program, design.numerics)
    found = []
    for width in (8, 12, 16, 24, 32):
        forms = engine.forms(replace(design.numerics, width=width))
        run = engine.run(forms, 18, drive_of(program, reals.scaling, on))
        found.append(estimated_luts(engine, run, part))
    assert np.all(np.diff(found) > 0)
