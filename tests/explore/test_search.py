"""Formats that a search chooses hold on tracks it has not seen, and cost less than uniform words."""

from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.design import Design
from kalmanhdl.design_file import loads
from kalmanhdl.design_file.writer import dumps
from kalmanhdl.errors import DesignError, FormatError
from kalmanhdl.explore.choice import place_forms, specification_of, variables_of
from kalmanhdl.explore.evaluator import Point
from kalmanhdl.explore.format_engine import FormatEngine
from kalmanhdl.explore.program import program_of
from kalmanhdl.explore.search import front_of, search
from kalmanhdl.explore.tracks import drawn_plots, judged
from kalmanhdl.numerics.integers import in_reals, numbers
from kalmanhdl.simulate.side_by_side import simulate

LEE = Design.load("designs/lee1997.toml")


def point(cost, share):
    return Point(bits=1, cost=cost, share=share, error=share, shift=float("nan"))


def test_the_front_has_no_point_that_another_beats():
    random = np.random.default_rng(1)
    points = [point(float(c), float(e)) for c, e in random.integers(1, 20, (200, 2))]
    front = front_of([*points, point(0.0, float("inf"))])
    assert all(any(q.cost <= p.cost and q.share <= p.share for q in front) for p in points)
    assert not any(p != q and p.cost <= q.cost and p.share <= q.share for p in front for q in front)


def test_formats_placed_are_those_of_the_specification_written():
    reals = in_reals(LEE.model, LEE.algorithm, LEE.numerics)
    program = program_of(reals.graph, reals.ranges)
    variables = variables_of(program, {"x[0]": 2, "reciprocal": 1})
    widths = np.random.default_rng(2).integers(4, 24, len(variables))
    engine = FormatEngine.of(program, LEE.numerics)
    written = engine.forms(specification_of(LEE.numerics, variables, widths))
    np.testing.assert_array_equal(
        place_forms(engine.forms(LEE.numerics), program, variables, widths), written
    )


@pytest.mark.slow
def test_chosen_formats_hold_on_other_tracks_and_load_again():
    found = search(LEE, tolerance=0.02, tracks=32)
    assert found.point.bits < 0.85 * found.uniform_point.bits
    assert found.unseen <= 0.02
    design = loads(dumps(replace(LEE, numerics=found.specification)))
    typed = numbers(design.model, design.algorithm, design.numerics)
    on = judged(design.model, design.algorithm(design.model), drawn_plots(design.model, 5, 200, 64, 999))
    simulation = simulate(design.model, design.algorithm(design.model), typed, on.plots)
    assert simulation.saturations == 0
    assert np.max(on.excess(simulation.exact.x)) < 0.03
    again = search(LEE, tolerance=0.02, tracks=32, workers=1)
    np.testing.assert_array_equal(again.widths, found.widths)


@pytest.mark.slow
def test_formats_keep_the_filter_consistent_where_that_is_asked():
    division = TableNewton(index_bits=7, iterations=1)
    found = search(
        replace(LEE, numerics=replace(LEE.numerics, division=division)), tolerance=None, consistency=True
    )
    reference, exact = found.bands
    assert exact.nees.consistent
    assert exact.nis.consistent
    assert reference.nis.samples == exact.nis.samples > 25_000
    assert found.point.bits < found.uniform_point.bits
    assert found.unseen is None


@pytest.mark.slow
def test_a_table_too_coarse_for_consistency_is_named_with_what_it_does():
    with pytest.raises(FormatError, match=r"moves by 0\.\d\d of half its band.*more than 7 bits or a Newton"):
        search(LEE, tolerance=None, consistency=True)


def test_something_must_be_asked_for():
    with pytest.raises(DesignError, match="give one, or ask for consistency"):
        search(LEE, tolerance=None)
