"""The experiments of liu2007: convergence, and the bits that algorithms need."""

import numpy as np
import pytest

from kalmanhdl.algorithm import BiermanThornton
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.design import Design
from kalmanhdl.explore.sweep import Row
from kalmanhdl.numerics.specification import SIGNAL_CLASSES, FixedSpecification
from kalmanhdl.pipeline import simulate
from kalmanhdl.reproduce.liu2007 import (
    Figures,
    accuracy,
    chosen_model,
    converge,
    drawn,
    least_width,
    reproduction,
)


def row(algorithm, width, broken=""):
    return Row(
        algorithm=algorithm,
        width=width,
        squared_error=1.0,
        float_squared_error=1.0,
        excess=0.0,
        clamped=0,
        broken=broken,
    )


def test_the_taylor_filter_converges_but_not_as_fast():
    found = converge(steps=100, tracks=100)
    assert found.taylor[0] == pytest.approx(found.optimal[0], rel=1e-9)
    assert (found.taylor[5:] > found.optimal[5:]).all()
    assert found.taylor[-1] < 0.15 * found.taylor[0]
    assert found.within(found.optimal, 0.2) < found.within(found.taylor, 0.2) < 100


def test_a_constant_state_is_estimated_as_least_squares_do():
    model, state = chosen_model(moving=False), np.array([1.0, -0.5, 2.0, 1.5])
    plots = drawn(model, state, 20, 3, 4)
    assert (plots.truth == state).all()
    H, R = np.tile(model.H, (20, 1)), model.R[0, 0]
    A = H.T @ H / R + np.linalg.inv(model.initial.P)
    expected = [np.linalg.solve(A, H.T @ plots.z[:, k].ravel() / R) for k in range(3)]
    found = simulate(Design(name="liu2007", model=model), plots)
    np.testing.assert_allclose(found.reference.x[-1], expected, atol=1e-9)


def test_the_shortest_word_is_behind_the_last_that_breaks():
    rows = (row("a", 8, "x"), row("a", 10), row("a", 12, "x"), row("a", 14), row("b", 8), row("c", 8, "x"))
    assert [least_width(rows, kind) for kind in "abc"] == [14, 8, None]


def test_a_table_has_a_row_for_each_word_and_marks_what_breaks():
    rows = (row("taylor", 8, "x"), row("taylor", 10), row("conventional", 8), row("conventional", 10))
    found = reproduction(Figures(convergence=converge(steps=10, tracks=2), rows=rows))
    assert found.rows[0] == ("8 bits", "1 *", "1")
    assert found.rows[-2:] == (
        ("shortest word that holds", "10", "8"),
        ("the same in the paper", "less than 18", "not given"),
    )
    assert set(found.charts) == {"convergence", "accuracy"}


@pytest.mark.slow
def test_taylor_needs_fewer_bits_than_bierman_and_thornton_which_break_below_18():
    rows = accuracy((14, 16, 18, 20), ("taylor", "bierman_thornton"))
    assert least_width(rows, "bierman_thornton") == 18
    assert least_width(rows, "taylor") == 16


@pytest.mark.slow
def test_the_words_are_those_of_the_bit_exact_engine():
    (swept,) = accuracy((16,), ("bierman_thornton",))
    model = chosen_model()
    plots = drawn(model, np.random.default_rng(1).standard_normal(4), 1000, 1, 1)
    numerics = FixedSpecification(
        classes=dict.fromkeys(SIGNAL_CLASSES, Fixed(width=16, fraction=8)),
        scale=(1.0,) * 4,
        covariance_scale=1.0,
    )
    design = Design(name="liu2007", model=model, algorithm=BiermanThornton(), numerics=numerics)
    found = simulate(design, plots)
    assert swept.squared_error == pytest.approx(np.mean((found.exact.x - plots.truth) ** 2), rel=1e-12)
    assert swept.clamped == found.saturations
