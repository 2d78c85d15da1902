"""From reals to integers: what the formats promise."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import strategies as st

from kalmanhdl.algorithm import ALGORITHMS, LINEAR, Taylor
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.design import Design
from kalmanhdl.errors import FormatError
from kalmanhdl.graph.operations import Multiply, Outside, Quantise, operands
from kalmanhdl.model.initial import given
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.integers import numbers
from kalmanhdl.numerics.signed_digits import canonical_signed_digits
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.simulate.interpreter import interpret
from kalmanhdl.simulate.side_by_side import simulate
from random_designs import covering, random_design

LEE = Design.load("designs/lee1997.toml")


@drawn(st.integers(1, 1 << 40))
def test_signed_digits_give_the_number_with_no_two_side_by_side(value):
    digits = canonical_signed_digits(value)
    assert sum(sign << place for sign, place in digits) == value
    places = [place for _, place in digits]
    assert all(b - a >= 2 for a, b in pairwise(places))


def test_no_multiplication_by_a_constant_is_left():
    typed = numbers(LEE.model, ALGORITHMS["conventional"](), LEE.numerics).typed
    operations = typed.graph.operations
    for operation in operations:
        if isinstance(operation, Multiply):
            assert type(operations[operation.a]).__name__ != "Constant"


def test_one_measurement_has_unit_variance_and_states_fill_their_format():
    found = numbers(LEE.model, ALGORITHMS["conventional"](), LEE.numerics).scaling
    assert np.all(np.log2(found.state) == np.round(np.log2(found.state)))
    variance = np.diag(LEE.model.R) / found.measurement**2 / found.covariance[[0, 2]]
    np.testing.assert_allclose(variance, 1.0, rtol=1e-15)


def test_every_flag_belongs_to_a_value_that_can_leave_its_format():
    typed = numbers(LEE.model, ALGORITHMS["conventional"](), LEE.numerics).typed
    operations = typed.graph.operations
    for violation in typed.violations:
        flag = operations[violation.outside]
        # That of a value which is taken under a condition counts under it.
        flags = [flag] if isinstance(flag, Outside) else [operations[i] for i in operands(flag)]
        assert any(isinstance(each, Outside) for each in flags)
        assert violation.starting or violation.running


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(25))
def test_every_value_stays_within_its_interval_and_format(seed):
    design = random_design(seed, max_states=3, max_measurements=2)
    typed = numbers(design.model, design.algorithm, design.numerics).typed
    random = np.random.default_rng(seed)
    state = {name: 0 for name, _ in typed.graph.states}
    for _ in range(4):
        leaves = {}
        for operation, form in zip(typed.graph.operations, typed.formats, strict=True):
            kind = type(operation).__name__
            if kind == "Input":
                leaves[operation.name] = int(random.integers(form.lowest, form.highest, endpoint=True))
            elif kind == "Flag":
                leaves[operation.name] = bool(random.random() < 0.6)
        values = interpret(typed, leaves, state).values
        for index, (value, form, interval) in enumerate(
            zip(values, typed.formats, typed.intervals, strict=True)
        ):
            if form is not None:
                assert interval.low <= value <= interval.high, typed.graph.operations[index]
                assert form.lowest <= value <= form.highest, typed.graph.operations[index]
        state = {name: values[root] for name, root in typed.graph.states}


# The start and misses are far above the steady state, where Taylor's expansion would not converge.
CHOICES = [
    Taylor(covering(LEE.model), newton=2) if kind == "taylor" else ALGORITHMS[kind]()
    for kind in sorted(LINEAR)
]


@pytest.mark.parametrize("algorithm", CHOICES, ids=lambda algorithm: algorithm.kind)
def test_wide_formats_come_close_to_the_float_reference(algorithm):
    random = np.random.default_rng(5)
    steps = np.arange(60)[:, None] * [40.0, 1e-3] * 15 + [5e4, 0.3]
    z = steps + random.standard_normal((60, 2)) * [1000.0, 0.017]
    z[20:23] = np.nan
    # A gain that knows of no missed plots has a NIS of thousands after them: 16 bits hold it in quarters.
    specification = FixedSpecification(width=40, classes={"constant": 40, "nis": 24})
    found = numbers(LEE.model, algorithm, specification)
    result = simulate(LEE.model, algorithm(LEE.model), found, plots_from_arrays(z, LEE.model))
    assert result.saturations == 0
    spread = np.sqrt(np.nanmax(np.abs(result.reference.P[..., range(4), range(4)]), axis=(0, 1)))
    error = np.nanmax(np.abs(result.exact.x - result.reference.x), axis=(0, 1))
    assert np.all(error < 1e-6 * spread)
    np.testing.assert_allclose(result.exact.nis, result.reference.nis, rtol=1e-2, atol=0.05)


def test_a_start_outside_its_format_is_refused_with_a_remedy():
    specification = FixedSpecification(
        classes={"covariance": Fixed(width=12, fraction=8)}, scale=(1.0,) * 4, covariance_scale=1.0
    )
    message = (
        r"^\[numerics\] covariance: P\[0,0\] starts at 1e\+06 but .* ends at .*: give \[numerics.signals\] P"
    )
    with pytest.raises(FormatError, match=message):
        numbers(LEE.model, ALGORITHMS["conventional"](), specification)


def test_formats_that_are_given_are_kept():
    form = Fixed(width=32, fraction=20)
    specification = FixedSpecification(
        classes=dict.fromkeys(("state", "covariance", "gain", "measurement", "innovation"), form)
    )
    typed = numbers(LEE.model, ALGORITHMS["conventional"](), specification).typed
    roots = dict(typed.graph.states)
    assert typed.formats[roots["x[0]"]] == form
    quantised = [o.form for o in typed.graph.operations if isinstance(o, Quantise)]
    assert form in quantised
    assert typed.formats[roots["P[0,0]"]].resolution == Fraction(1, 1 << 20)


def test_a_measurement_that_is_missed_saturates_nothing():
    z = np.stack([100e3 + 1500.0 * np.arange(12), np.full(12, 0.3)], axis=1)
    # A missed plot comes as zero, far from the track.
    z[6:9, 0] = np.nan
    result = LEE.simulate(z)
    assert result.saturations == 0
    z[6:9, 0] = 0.0
    assert LEE.simulate(z).saturations > 0


def test_a_start_fits_also_where_every_track_leaves_the_declared_ranges_at_once():
    wild = replace(LEE.model, R=np.diag([1e13, 2.9e-4]))
    found = numbers(wild, ALGORITHMS["conventional"](), LEE.numerics)
    assert dict(found.typed.graph.states)


def test_a_prediction_that_a_valid_measurement_puts_aside_saturates_nothing():
    # Formats for no miss at all: the first prediction of P is beyond them, and is never kept.
    model = linear_model(
        [[1, 0.5], [0, 1]],
        [[1, 0]],
        np.diag([0.01, 0.2]),
        [[4]],
        initial=given([0, 0], np.diag([100, 25])),
        measurement_range=[[-500, 500]],
    )
    design = Design(name="near", model=model, numerics=FixedSpecification(width=32, coast=0))
    kept = design.simulate(np.array([[1], [2], [1], [2], [3]]))
    assert kept.saturations == 0
    missed = design.simulate(np.array([[1], [np.nan], [np.nan], [np.nan], [3]]))
    assert missed.saturations > 0
