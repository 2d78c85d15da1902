"""Converted measurements against exact figures, another library's, and chance itself."""

import csv
from decimal import Decimal, getcontext
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.errors import ModelError
from kalmanhdl.graph.elements import elements
from kalmanhdl.model.conversion import UNBIASINGS, conversion, measured, sight, sight_of

DATA = Path(__file__).parents[1] / "data"
FLAT = list(csv.DictReader((DATA / "converted_measurement_2d_lerro1993_40digits.csv").open()))
SOLID = list(csv.DictReader((DATA / "converted_measurement_3d_tcl.csv").open()))
# Standard deviations of wu2012, and those of lee1997 with an elevation of the same quality.
WU2012 = ((700.0, np.pi / 90, np.pi / 90), (1 / 6, np.pi / 180, np.pi / 270))
FAR = ((160e3, 0.3, 0.05), (1000.0, 0.017, 0.017))
STEEP = ((1000.0, 0.7, 1.1), (5.0, 0.2, 0.3))


def moments(z, sigmas, unbiasing="debiased"):
    """Mean and covariance as arrays of floats."""
    convert = conversion(tuple(sigma**2 for sigma in sigmas), unbiasing)
    z = np.array(z, object)
    return convert.mean(z).astype(float), convert.covariance(sight(z)).astype(float)


def numbers(row, *keys):
    return [float(row[key]) for key in keys]


@pytest.mark.parametrize("row", FLAT, ids=lambda row: f"r={row['r']}")
def test_flat_conversion_has_the_exact_debiased_moments(row):
    mean, R = moments(numbers(row, "r", "theta"), numbers(row, "sigma_r", "sigma_theta"))
    np.testing.assert_allclose(mean, numbers(row, "x_debiased", "y_debiased"), rtol=1e-15)
    expected = numbers(row, "R11", "R12", "R22")
    np.testing.assert_allclose([R[0, 0], R[1, 1]], expected[::2], rtol=1e-14)
    # Radial and tangential variance cancel where they are alike, and squares of deviations are rounded.
    assert R[0, 1] == pytest.approx(expected[1], rel=1e-12, abs=0)
    assert R[1, 0] == R[0, 1]


@pytest.mark.parametrize("row", SOLID, ids=lambda row: f"{row['algorithm']}, r={row['r']}")
def test_solid_conversion_agrees_with_another_library(row):
    unbiasing = {"0": "unbiased", "1": "modified"}[row["algorithm"]]
    z, sigmas = numbers(row, "r", "az", "el"), numbers(row, "sigma_r", "sigma_az", "sigma_el")
    mean, R = moments(z, sigmas, unbiasing)
    np.testing.assert_allclose(mean, numbers(row, "x", "y", "z"), rtol=1e-14)
    upper = R[np.triu_indices(3)]
    expected = numbers(row, "R11", "R12", "R13", "R22", "R23", "R33")
    # Theirs are differences of products as large as the square of the range.
    np.testing.assert_allclose(upper, expected, rtol=0, atol=1e-15 * z[0] ** 2)


def test_solid_conversion_in_the_plane_is_the_flat_one():
    for unbiasing in UNBIASINGS:
        flat = moments((500.0, 1.2), (3.0, 0.05), unbiasing)
        solid = moments((500.0, 1.2, 0.0), (3.0, 0.05, 0.0), unbiasing)
        np.testing.assert_allclose(solid[0][:2], flat[0], rtol=1e-15)
        np.testing.assert_allclose(solid[1][:2, :2], flat[1], rtol=1e-14)
        assert not solid[1][2].any()


def cartesian(r, azimuth, elevation):
    level = r * np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), r * np.sin(elevation)])


def inside(samples, expected, errors=4):
    """Whether the mean of samples (..., draws) is as expected within standard errors."""
    mean, deviation = samples.mean(axis=-1), samples.std(axis=-1)
    return np.all(np.abs(mean - expected) <= errors * deviation / np.sqrt(samples.shape[-1]))


@pytest.mark.parametrize("unbiasing", UNBIASINGS)
@pytest.mark.parametrize("case", [WU2012, FAR, STEEP], ids=["wu2012", "far", "steep"])
def test_a_million_draws_have_these_moments(case, unbiasing):
    z, sigmas = np.array(case[0]), np.array(case[1])
    random, draws = np.random.default_rng(1), 1_000_000

    def noise():
        return sigmas[:, None] * random.standard_normal((3, draws))

    # Where the target may be, given that it was measured at z.
    true = z[:, None] - noise()
    position = cartesian(*true)
    mean, R = moments(z, sigmas, unbiasing)
    if unbiasing == "modified":
        assert inside(position, mean)
        error = position - mean[:, None]
        assert inside(error[:, None] * error[None, :], R)
        return
    again, other = cartesian(*(true + noise())), cartesian(*(true + noise()))
    plain = cartesian(*z)
    if unbiasing == "debiased":
        assert inside(again - position, plain - mean)
    else:
        factor = (mean / plain)[:, None]
        again, other = factor * again, factor * other
        assert inside(again - position, np.zeros(3))
    # Half the squared difference of two measurements of one target: its mean is their covariance.
    difference = (again - other) / np.sqrt(2)
    assert inside(difference[:, None] * difference[None, :], R)


def exact_covariance(z, sigmas):
    """The debiased covariance as Suchomski prints it, on the doubles given, in 80 digits."""
    getcontext().prec = 80
    r, azimuth, elevation = map(Decimal, map(float, z))
    s_r, s_a, s_e = (Decimal(float(sigma)) ** 2 for sigma in sigmas)

    def trigonometric(angle):
        sine = cosine = Decimal(0)
        term = Decimal(1)
        for order in range(0, 120, 2):
            cosine, sine = cosine + term, sine + term * angle / (order + 1)
            term = -term * angle**2 / ((order + 1) * (order + 2))
        return cosine, sine

    def weighted(s, cosine, sine):
        cosh, sinh = (s.exp() + (-s).exp()) / 2, (s.exp() - (-s).exp()) / 2
        return cosine**2 * cosh + sine**2 * sinh

    (ca, sa), (ce, se) = trigonometric(azimuth), trigonometric(elevation)
    a_x, b_x = weighted(s_a, ca, sa), weighted(2 * s_a, ca, sa)
    a_y, b_y = weighted(s_a, sa, ca), weighted(2 * s_a, sa, ca)
    a, b = weighted(s_e, ce, se), weighted(2 * s_e, ce, se)
    a_z, b_z = weighted(s_e, se, ce), weighted(2 * s_e, se, ce)
    e2 = (-2 * s_a - 2 * s_e).exp()
    upright = se * ce * (-s_a - 4 * s_e).exp() * (r**2 * (1 - s_e.exp()) + s_r * (2 - s_e.exp()))
    upper = [
        e2 * (r**2 * (b_x * b - a_x * a) + s_r * (2 * b_x * b - a_x * a)),
        sa * ca * (-4 * s_a - 2 * s_e).exp() * (r**2 * (b - a * s_a.exp()) + s_r * (2 * b - a * s_a.exp())),
        ca * upright,
        e2 * (r**2 * (b_y * b - a_y * a) + s_r * (2 * b_y * b - a_y * a)),
        sa * upright,
        (-2 * s_e).exp() * (r**2 * (b_z - a_z) + s_r * (2 * b_z - a_z)),
    ]
    R = np.zeros((3, 3))
    R[np.triu_indices(3)] = list(map(float, upper))
    return np.maximum(R, 0) + np.minimum(R, 0) + np.triu(R, 1).T


single = st.floats(-3, 3, width=32)


@given(
    r=st.floats(1, 2e5, width=32),
    angles=st.tuples(single, st.floats(-1.5, 1.5, width=32)),
    relative=st.floats(1e-5, 0.1),
    spread=st.tuples(st.floats(1e-5, 0.3), st.floats(1e-5, 0.3)),
)
def test_covariance_has_the_digits_of_its_arithmetic(r, angles, relative, spread):
    """Doubles within 1e-14 and 32-bit floats within 2e-6, of each variance, and of the roots across."""
    z, sigmas = (r, *angles), (r * relative, *spread)
    exact = exact_covariance(z, sigmas)
    root = np.sqrt(np.diag(exact))
    convert = conversion(tuple(sigma**2 for sigma in sigmas))
    for kind, tolerance in ((np.float64, 1e-14), (np.float32, 2e-6)):
        z_kind = np.array([kind(value) for value in z], object)
        R = convert.covariance(sight(z_kind))
        assert {type(entry) for entry in R.ravel()} == {kind}
        assert np.all(np.abs(R.astype(float) - exact) <= tolerance * np.outer(root, root))


def test_single_precision_keeps_what_the_printed_form_loses():
    z, sigmas = (20e3, 1.0, 0.2), (50.0, 1e-3, 1e-3)
    s = np.float32(sigmas[2] ** 2)
    exact = exact_covariance(z, sigmas)[2, 2]
    c2, s2 = np.cos(np.float32(z[2])) ** 2, np.sin(np.float32(z[2])) ** 2
    alpha = s2 * np.cosh(s) + c2 * np.sinh(s)
    beta = s2 * np.cosh(2 * s) + c2 * np.sinh(2 * s)
    printed = np.exp(-2 * s) * (
        np.float32(z[0] ** 2) * (beta - alpha) + np.float32(2500) * (2 * beta - alpha)
    )
    assert abs(printed / exact - 1) > 1e-4
    ours = conversion(tuple(sigma**2 for sigma in sigmas)).covariance(
        sight(np.array([np.float32(value) for value in z], object))
    )
    assert abs(ours[2, 2] / exact - 1) < 1e-6


@given(
    z=st.tuples(st.floats(1, 1e5), single, st.floats(-1.5, 1.5)),
    spread=st.tuples(st.floats(1e-4, 1), st.floats(1e-4, 1), st.floats(1e-4, 1)),
    unbiasing=st.sampled_from(UNBIASINGS),
)
def test_covariance_is_positive_definite(z, spread, unbiasing):
    _, R = moments(z, (z[0] * spread[0], *spread[1:]), unbiasing)
    root = np.sqrt(np.diag(R))
    assert np.linalg.eigvalsh(R / np.outer(root, root))[0] > 0


@pytest.mark.parametrize("size", [2, 3])
def test_a_position_is_seen_where_it_is_measured(size):
    random = np.random.default_rng(2)
    position = random.normal(size=(100, size)) * 100
    z = measured(elements(position))
    one, other = sight(z), sight_of(elements(position))
    np.testing.assert_allclose(one.range_squared, other.range_squared, rtol=1e-12)
    np.testing.assert_allclose(one.azimuth, other.azimuth, atol=1e-12)
    if size == 3:
        np.testing.assert_allclose(one.elevation, other.elevation, atol=1e-12)
    exact = conversion((1.0,) + (0.0,) * (size - 1)).mean(z)
    np.testing.assert_allclose(np.stack(list(exact), axis=1), position, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((1.0, 20.0), "debiased"), "[model] R: the variance of azimuth, 20, is from 0 to 10 rad^2"),
        (((1.0, 0.1, -1.0), "debiased"), "the variance of elevation, -1"),
        (((1.0, 0.1), "biased"), 'write one of "debiased", "unbiased", "modified"'),
    ],
)
def test_a_conversion_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ModelError) as caught:
        conversion(*arguments)
    assert message in str(caught.value)
