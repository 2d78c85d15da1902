"""The experiment of kumar2014: which constants give its printed samples."""

from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.design import Design
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.kumar2014 import (
    figures,
    fitted_model,
    paper_design,
    paper_model,
    reproduction,
)
from test_design_file import assert_same

DESIGNS = Path(__file__).parents[2] / "designs"


@pytest.fixture(scope="module")
def found():
    return figures()


def test_the_design_file_is_the_papers_filter():
    design, again = Design.load(DESIGNS / "kumar2014.toml"), paper_design(paper_model())
    assert_same(design.model, again.model)
    assert (design.numerics, design.algorithm) == (again.numerics, again.algorithm)


def settled_by_hand(T, p11, p12, p22, q, samples):
    """The scalar equations of section 4.1, with P over the measurement variance and G21 as lee1997 has it."""
    x, rate, states = 10.0, 0.0, []
    for _ in range(samples):
        p11, p12, p22 = p11 + 2 * T * p12 + T * T * p22, p12 + T * p22, p22 + q
        g1, g2 = p11 / (p11 + 1), p12 / (p11 + 1)
        p11, p12, p22 = p11 - p11 * g1, p12 - p12 * g1, p22 - p12 * g2
        x = x + T * rate
        x, rate = x + g1 * (20 - x), rate + g2 * (20 - x)
        states.append((x, rate))
    return np.array(states)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_reference_is_the_papers_equations(found, axis):
    lee, fit = facts("kumar2014")["lee1997"], facts("kumar2014")["fitted"]
    r = lee["measurement"][axis]
    p = np.array(lee["covariance"][axis]) / r
    by_hand = settled_by_hand(lee["T"], *p, lee["process"][axis] / r, 30)
    np.testing.assert_allclose(
        found.lee1997.reference[:, 2 * axis : 2 * axis + 2], by_hand, rtol=1e-9, atol=1e-9
    )
    by_hand = settled_by_hand(fit["T"], *fit["covariance"], fit["process"], 30)
    np.testing.assert_allclose(found.fitted.reference[:, 2 * axis : 2 * axis + 2], by_hand, atol=1e-9)


def test_the_fitted_constants_give_the_printed_samples(found):
    data = facts("kumar2014")
    for sample, name in ((0, "first"), (9, "tenth")):
        printed = np.tile(data[name], 2)
        np.testing.assert_allclose(found.fitted.reference[sample], printed, atol=1e-9)
        # In Q12.20, where the roundings of ten samples add up.
        np.testing.assert_allclose(found.fitted.exact[sample], printed, atol=100 * 2.0**-20)
    assert abs(found.fitted.exact[9, 0] / 20 - 1) < 0.002
    assert np.linalg.eigvalsh(fitted_model().initial.P)[0] > 0


def test_the_constants_of_lee1997_settle_within_half_a_percent(found):
    assert 0.002 < abs(found.lee1997.exact[9, 0] / 20 - 1) < 0.005
    assert found.lee1997.exact[0, 1] > 0


def test_every_row_has_every_column(found):
    handed = reproduction(found)
    assert {len(row) for row in handed.rows} == {len(handed.columns)}
    assert set(handed.charts) == {"settling"}
