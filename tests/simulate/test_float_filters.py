"""Whole filters in floating point: engine against interpreter, and what a format is good for."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kalmanhdl.algorithm import BiermanThornton, Conventional, Joseph, Scheduled
from kalmanhdl.arithmetic.fixed import Rounding
from kalmanhdl.design import Design
from kalmanhdl.model.initial import given
from kalmanhdl.model.motion import constant_velocity
from kalmanhdl.model.singer import singer
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.floating import FloatSpecification, float_numbers
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.simulate.engine import Engine
from kalmanhdl.simulate.side_by_side import simulate, stimulus_of

ROOT = Path(__file__).parents[2]
LEE = Design.load(ROOT / "designs" / "lee1997.toml")
SINGLE = FloatSpecification(exponent=8, mantissa=23)
DOUBLE = FloatSpecification(exponent=11, mantissa=52)
SPECIFICATIONS = (
    SINGLE,
    replace(SINGLE, fused=True),
    replace(SINGLE, rounding=Rounding.TOWARD_ZERO, subnormals=False),
    replace(DOUBLE, rounding=Rounding.TOWARD_ZERO, fused=True),
    FloatSpecification(exponent=9, mantissa=12, fused=True),
    FloatSpecification(exponent=10, mantissa=40),
)


def plots(model, steps, tracks, seed=1):
    """Straight paths with rows and components missing."""
    random = np.random.default_rng(seed)
    begin, rate = random.uniform(2e4, 8e4, (1, tracks, 1)), random.normal(0, 9, (1, tracks, 1))
    z = begin + rate * np.arange(steps)[:, None, None] + random.normal(0, 300, (steps, tracks, model.m))
    z[3:][random.random((steps - 3, tracks, model.m)) < 0.2] = np.nan
    return plots_from_arrays(z, model)


@pytest.mark.parametrize("algorithm", [Conventional(), BiermanThornton(), Joseph()], ids=lambda a: a.kind)
@pytest.mark.parametrize("specification", SPECIFICATIONS, ids=lambda s: f"{s.form} {s.form.rounding.value}")
def test_a_filter_is_as_defined(algorithm, specification):
    typed = float_numbers(LEE.model, algorithm, specification).typed
    stimulus = stimulus_of(LEE.model, typed, plots(LEE.model, 12, 5))
    engine = Engine.of(typed)
    assert engine.compiled
    active = stimulus.commands >= 0
    found, expected = (
        each.run(stimulus.inputs, stimulus.flags, active=active)
        for each in (engine, replace(engine, library=None))
    )
    for name, values in expected.outputs.items():
        np.testing.assert_array_equal(found.outputs[name][active], values[active], name)
    for name, values in expected.states.items():
        np.testing.assert_array_equal(found.states[name], values, name)
        np.testing.assert_array_equal(found.final_state[name], expected.final_state[name])
    assert found.violations == expected.violations


def nine_states():
    """Three axes of manoeuvring targets whose measured positions have correlated errors: one dense filter."""
    motion = singer(T=0.5, tau=20.0, noise=4.0, axes=3)
    R = 100.0**2 * np.array([[1, 0.5, 0.2], [0.5, 1, 0.4], [0.2, 0.4, 1]])
    P = np.kron(np.eye(3), np.diag([1e4, 1e3, 10.0]))
    return linear_model(
        motion.F, motion.H, motion.Q, R, initial=given(np.zeros(9), P), state_names=motion.state_names
    )


@pytest.mark.parametrize(("mantissa", "exponent", "share"), [(23, 8, 2e-3), (36, 10, 3e-7), (52, 11, 5e-12)])
def test_nine_states_stay_near_the_reference(mantissa, exponent, share):
    model = nine_states()
    random = np.random.default_rng(5)
    z = np.cumsum(random.normal(0, 40, (150, 20, 3)), axis=0) + random.normal(0, 100, (150, 20, 3))
    numbers = float_numbers(model, Conventional(), FloatSpecification(exponent=exponent, mantissa=mantissa))
    found = simulate(model, Conventional()(model), numbers, plots_from_arrays(z, model))
    deviation = np.sqrt(np.einsum("...ii->...i", found.reference.P))
    assert np.abs((found.exact.x - found.reference.x) / deviation).max() < share
    spread = deviation[..., None] * deviation[..., None, :]
    assert np.abs((found.exact.P - found.reference.P) / spread).max() < share
    assert found.saturations == 0


# Functions, a table of gains, and the filters that every release ships.
OTHERS = [path.stem for path in sorted((ROOT / "designs").glob("*.toml")) if path.stem != "lee1997"]
QUICK = ("ekf_radar", "imm_radar", "lee1997")


def largest_error(design, specification):
    """The greatest distance from the reference, in standard deviations, over tracks drawn from the model."""
    model, drawn = design.model, simulated(design.model, coast=2, steps=30, tracks=20)
    z = np.where(drawn.valid, drawn.z, np.nan)
    data = plots_from_arrays(z, model, drawn.u if model.p else None)
    numbers = float_numbers(model, design.algorithm, specification)
    found = simulate(model, design.algorithm(model), numbers, data)
    assert found.saturations == 0
    deviation = np.sqrt(np.einsum("...ii->...i", found.reference.P))
    return np.nanmax(np.abs(found.exact.x - found.reference.x) / deviation)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in ("lee1997", *OTHERS)],
)
def test_designs_in_floating_point_stay_near_the_reference(name):
    design = Design.load(ROOT / "designs" / f"{name}.toml")
    assert largest_error(design, DOUBLE) < 1e-8
    # The variances of wu2012 fall by thirteen decades, of which single precision holds seven.
    assert largest_error(design, SINGLE) < (0.5 if name.startswith("wu2012") else 0.01)


def test_a_table_of_gains_is_read_by_its_rows():
    assert largest_error(replace(LEE, algorithm=Scheduled()), SINGLE) < 1e-3


def test_what_becomes_infinite_is_counted_where_it_happens():
    motion = constant_velocity(T=1.0, noise=4.0)
    model = linear_model(motion.F, motion.H, motion.Q, [[1.0]], initial=given([0, 0], np.diag([6e4, 6e4])))
    numbers = float_numbers(model, Conventional(), FloatSpecification(exponent=5, mantissa=10))
    z = np.full((6, 3, 1), np.nan)
    z[0], z[:, 1] = 1.0, 1.0
    stimulus = stimulus_of(model, numbers.typed, plots_from_arrays(z, model))
    engine = Engine.of(numbers.typed)
    found = engine.run(stimulus.inputs, stimulus.flags)
    assert found.violations == replace(engine, library=None).run(stimulus.inputs, stimulus.flags).violations
    roots = dict(numbers.typed.graph.states)
    del roots["saturated"]
    infinite = {name: int((found.states[name] & 0x7FFF >= 0x7C00).sum()) for name in roots}
    assert infinite["P[0,0]"] > 0
    for name, count in infinite.items():
        assert found.violations[roots[name]] == count


def dyer(k):
    """The problem of Dyer and McReynolds, and the exact covariance after its update."""
    with (ROOT / "tests" / "data" / "dyer_mcreynolds_illconditioned_exact.csv").open() as file:
        row = next(row for row in csv.reader(file) if row[1] == str(k))
    P = np.zeros((3, 3))
    P[np.triu_indices(3)] = [float(number) for number in row[2:]]
    d = 2.0**-k
    H, R = [[1, 1, 1], [1, 1, 1 + d]], d * d * np.eye(2)
    model = linear_model(np.eye(3), H, np.zeros((3, 3)), R, initial=given(np.zeros(3), np.eye(3)))
    return model, np.triu(P) + np.triu(P, 1).T


@pytest.mark.filterwarnings("ignore:no sequence of measurements")
def test_factors_in_single_beat_the_covariance_in_double():
    model, P = dyer(20)

    def error(algorithm, specification):
        numbers = float_numbers(model, algorithm, specification)
        data = plots_from_arrays(np.zeros((1, 1, 2)), model)
        found = simulate(model, algorithm(model), numbers, data)
        return np.abs(found.exact.P[0, 0] / P - 1).max()

    assert error(BiermanThornton(), SINGLE) < 1e-6
    assert error(Conventional(), DOUBLE) > 1e-5
    assert error(Conventional(), SINGLE) > 0.5
