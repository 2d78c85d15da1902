"""Planes, ellipses, convergence and lanes against independent ways to them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.model.initial import given as given_start
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.report.accuracy import mean_nis, updated
from kalmanhdl.report.convergence import gains, innovation_covariances, priors
from kalmanhdl.report.geometry import Kind, ellipse, plane, points
from kalmanhdl.report.lanes import lanes
from kalmanhdl.report.plots import rate_sources
from kalmanhdl.schedule.summary import Row


def axes(names, units, T=0.5):
    """Constant acceleration on two axes of which the positions are measured."""
    block = np.array([[1, T, T * T / 2], [0, 1, T], [0, 0, 1]])
    return linear_model(
        np.kron(np.eye(2), block),
        np.kron(np.eye(2), [[1, 0, 0]]),
        np.eye(6),
        np.eye(2),
        initial=given_start(np.zeros(6), np.eye(6)),
        state_names=[f"{kind}{name}" for name in names for kind in ("", "v_", "a_")],
        state_units=[unit for unit in units for _ in range(3)],
    )


def test_range_and_bearing_are_drawn_on_a_plane(radar, nile):
    assert plane(radar.hardware.design.model).kind is Kind.POLAR
    assert plane(nile.hardware.design.model).kind is Kind.TIME
    shown = plane(axes(("x", "y"), ("m", "m")))
    assert (shown.kind, shown.states) == (Kind.CARTESIAN, (0, 3))
    assert plane(axes(("x", "heat"), ("m", "K"))).kind is Kind.TIME


def test_velocity_is_the_rate_of_a_position_and_acceleration_is_not():
    shown = np.array([True, False, False, True, False, False])
    assert rate_sources(axes(("x", "y"), ("m", "m")), shown) == {1: 0, 4: 3}


def test_an_ellipse_holds_95_per_cent_of_the_positions_it_stands_for(radar):
    shown, rng = plane(radar.hardware.design.model), np.random.default_rng(1)
    x, P = np.array([1000.0, 0, 0.7, 0]), np.diag([100.0, 1, 1e-4, 1])
    drawn = rng.multivariate_normal(x, P, 20000)
    around = ellipse(shown, x, P)
    centre = points(shown, x[[0, 2]])
    # A point is inside where it is nearer to the centre than the line in its direction.
    shape = np.linalg.inv(np.cov((around[:-1] - centre).T, bias=True)) / 2
    offset = points(shown, drawn[:, [0, 2]]) - centre
    inside = np.einsum("ki,ij,kj->k", offset, shape, offset) <= 1
    assert abs(inside.mean() - 0.95) < 0.01


def test_gains_and_innovation_covariances_give_the_covariance_that_followed(radar):
    model, simulation = radar.hardware.design.model, radar.simulation
    P = simulation.reference.P
    prior = priors(model, simulation, P)
    used = updated(simulation, model.initial.before_update)
    K = gains(model, prior, used)
    known = np.isfinite(K).all(axis=(-1, -2))
    assert known.sum() == used.all(axis=-1).sum() > 500
    after = (np.eye(4) - K @ model.H) @ prior
    np.testing.assert_allclose(after[known], P[known], rtol=1e-9, atol=1e-15)
    y, S = simulation.reference.innovation, innovation_covariances(model, prior)
    nis = np.einsum("...i,...ij,...j->...", y[known], np.linalg.inv(S[known]), y[known])
    np.testing.assert_allclose(nis, simulation.reference.nis[known], rtol=1e-8)


def test_the_band_of_the_mean_nis_counts_the_components_that_were_measured():
    used = np.ones((1000, 1, 2), dtype=bool)
    used[500:, :, 1] = False
    used[900:] = False
    rng = np.random.default_rng(2)
    means = [mean_nis((rng.normal(size=used.shape) ** 2 * used).sum(axis=-1), used) for _ in range(400)]
    assert {one.samples for one in means} == {900}
    assert abs(np.mean([one.consistent for one in means]) - 0.95) < 0.04


@given(
    st.lists(st.tuples(st.integers(0, 20), st.integers(0, 5), st.sampled_from(["add", "multiply", "new"])))
)
def test_no_two_bars_of_a_lane_overlap(operations):
    rows = [
        Row(label="", kind=kind, start=start, end=start + length, origin=f"%{k}")
        for k, (start, length, kind) in enumerate(operations)
    ]
    bars = lanes(rows)
    assert sorted(bar.work.origin for bar in bars) == sorted(row.origin for row in rows)
    places = [(bar.lane, cycle) for bar in bars for cycle in range(bar.left, bar.right)]
    assert len(set(places)) == len(places)
    for lane in {bar.lane for bar in bars}:
        assert len({bar.work.group for bar in bars if bar.lane == lane}) == 1
