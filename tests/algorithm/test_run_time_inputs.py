"""Filters with run-time inputs, against filterpy, against fixed ones, and as the graph of the hardware."""

import shutil

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given as forall
from hypothesis import settings
from hypothesis import strategies as st

from kalmanhdl.algorithm import ALGORITHMS, Extended
from kalmanhdl.algorithm.trace import trace
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.errors import ModelError
from kalmanhdl.graph.evaluate import evaluate
from kalmanhdl.model.initial import given
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.nonlinear import nonlinear_model
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.model.varying import VaryingModel, varying_model
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.ranges import simulated
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import compile_design, verify
from kalmanhdl.simulate.commands import commands
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.simulate.reference import reference
from random_designs import random_varying_model

SUITED = VaryingModel.suited


def estimated(model, algorithm, z, u):
    given_ = commands(model, z, np.ones(z.shape[:2], bool))
    return reference(algorithm(model), given_, z, u)


def drawn(model, seed, steps=12):
    plots = simulated(model, coast=3, steps=steps, tracks=3, seed=seed)
    return np.where(plots.valid, plots.z, np.nan), plots.u


@pytest.mark.parametrize("kind", SUITED)
@forall(seed=st.integers(0, 10_000))
@settings(max_examples=6, deadline=None)
def test_filterpy_with_matrices_set_anew_for_every_step_says_the_same(kind, seed):
    model = random_varying_model(np.random.default_rng(seed))
    z, u = drawn(model, seed)
    z[np.isnan(z).any(axis=2)] = np.nan
    found = estimated(model, ALGORITHMS[kind](), z, u)
    for track in range(z.shape[1]):
        kf = KalmanFilter(dim_x=model.n, dim_z=model.m)
        kf.x, kf.P, kf.H = model.initial.x[:, None].copy(), model.initial.P.copy(), model.fixed.H
        for k in range(len(z)):
            step = model.at(u[k, track].astype(object))
            drive = (step.B @ u[k, track] + step.offset).astype(float)
            if k:
                kf.predict(F=step.F.astype(float), Q=step.Q.astype(float))
                kf.x = kf.x + drive[:, None]
            row = None if np.isnan(z[k, track]).any() else z[k, track][:, None]
            kf.update(row, R=step.R.astype(float))
            np.testing.assert_allclose(found.x[k, track], kf.x[:, 0], rtol=1e-8, atol=1e-9)
            np.testing.assert_allclose(found.P[k, track], kf.P, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("kind", SUITED)
@forall(seed=st.integers(0, 10_000))
@settings(max_examples=4, deadline=None)
def test_inputs_that_stay_make_the_linear_filter(kind, seed):
    model = random_varying_model(np.random.default_rng(seed))
    z, u = drawn(model, seed)
    u = np.broadcast_to(u[:1, :1], u.shape)
    step = model.at(u[0, 0].astype(object))
    F, Q, R, B, offset = (np.asarray(array, float) for array in (step.F, step.Q, step.R, step.B, step.offset))
    start = given(model.initial.x, model.initial.P)
    fixed = linear_model(F, step.H, Q, R, initial=start, B=B, offset=offset)
    found = estimated(model, ALGORITHMS[kind](), z, u)
    expected = estimated(fixed, ALGORITHMS[kind](), z, u)
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("kind", SUITED)
@forall(seed=st.integers(0, 10_000))
@settings(max_examples=4, deadline=None)
def test_the_graph_says_what_the_reference_says(kind, seed):
    model = random_varying_model(np.random.default_rng(seed))
    filter_ = ALGORITHMS[kind]()(model)
    z, u = drawn(model, seed, steps=6)
    z = np.nan_to_num(z)
    graph = trace(model, filter_)
    state = {name: np.zeros(z.shape[1]) for name, _ in graph.states}
    given_ = commands(model, z, np.ones(z.shape[:2], bool))
    expected = reference(filter_, given_, z, u)
    for k in range(len(z)):
        leaves = dict(state) | {"initialise": np.full(z.shape[1], k == 0)}
        leaves |= {f"z[{j}]": z[k, :, j] for j in range(model.m)}
        leaves |= {f"valid[{j}]": np.ones(z.shape[1], bool) for j in range(model.m)}
        leaves |= {f"u[{i}]": u[k, :, i] for i in range(model.p)}
        with np.errstate(all="ignore"):
            values = evaluate(graph, leaves)
        state = {name: np.broadcast_to(values[root], z.shape[1]) for name, root in graph.states}
        x = np.stack([np.broadcast_to(values[dict(graph.outputs)[f"x[{i}]"]], 3) for i in range(model.n)], 1)
        np.testing.assert_allclose(x, expected.x[k], rtol=1e-9, atol=1e-10)


@forall(seed=st.integers(0, 10_000))
@settings(max_examples=4, deadline=None)
def test_the_extended_filter_takes_the_same_inputs(seed):
    """Of formulas that happen to be linear it is the filter of the varying model."""
    random = np.random.default_rng(seed)
    model = random_varying_model(random, 3, 2)
    if model.p > len(model.inputs):
        return
    names, F, size = model.state_names, model.texts["F"], model.n
    f = [
        " + ".join(f"({F[i * size + j]})*{names[j]}" for j in range(size))
        + f" + ({model.texts['offset'][i]})"
        for i in range(size)
    ]
    H = model.fixed.H
    curved = nonlinear_model(
        f,
        [
            " + ".join(f"{H[j, i]!r}*{names[i]}" for i in range(size)).replace("np.float64", "")
            for j in range(len(H))
        ],
        [list(model.texts["Q"][k * size : (k + 1) * size]) for k in range(size)],
        [list(model.texts["R"][k * len(H) : (k + 1) * len(H)]) for k in range(len(H))],
        initial=given(model.initial.x, model.initial.P),
        state_names=names,
        measurement_names=model.measurement_names,
        inputs=model.inputs,
    )
    z, u = drawn(model, seed)
    found = estimated(curved, Extended(), z, u)
    expected = estimated(model, ALGORITHMS["conventional"](), z, u)
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.P, expected.P, rtol=1e-8, atol=1e-10)


def _timed(Q):
    """A position and its speed, steps of any length, measured twice with noises that correlate."""
    return varying_model(
        [[1, "dt"], [0, 1]],
        [[1, 0], [0.5, 1]],
        Q,
        [["r", "0.3*r"], ["0.3*r", "2*r"]],
        inputs=[RunTimeInput(name="dt", low=0.5, high=2), RunTimeInput(name="r", low=0.1, high=3)],
        initial=given([0, 0], np.diag([100, 4])),
    )


def test_noise_that_a_step_correlates_is_factored_in_every_step():
    model = _timed([["dt^3/3", "dt^2/2"], ["dt^2/2", "dt"]])
    z, u = drawn(model, 1, steps=40)
    found = estimated(model, ALGORITHMS["bierman_thornton"](), z, u)
    expected = estimated(model, ALGORITHMS["conventional"](), z, u)
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.P, expected.P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-9, atol=1e-9)


def test_factors_of_a_singular_noise_that_varies_are_refused():
    model = _timed([["dt^4/4", "dt^3/2"], ["dt^3/2", "dt^2"]])
    with pytest.raises(ModelError, match=r"model\.Q of x0, x1 varies and is singular: use one"):
        ALGORITHMS["bierman_thornton"]()(model)


def _turning():
    """Range and bearing of a target whose step is as long as its input says, with noise that is told."""
    return nonlinear_model(
        ["x + dt*vx", "vx", "y + dt*vy", "vy"],
        ["hypot(x, y)", "atan2(y, x)"],
        [[0, 0, 0, 0], [0, "0.1*dt", 0, 0], [0, 0, 0, 0], [0, 0, 0, "0.1*dt"]],
        [["spread^2", 0], [0, 1e-3]],
        initial=given([50, 1, 50, 1], np.diag([25, 1, 25, 1])),
        state_names=["x", "vx", "y", "vy"],
        measurement_names=["range", "bearing"],
        inputs=[
            RunTimeInput(name="dt", low=0.5, high=2, from_time=True),
            RunTimeInput(name="spread", low=1, high=3),
        ],
        angles=["bearing"],
        measurement_range=[[10, 400], [-3.2, 3.2]],
    )


def test_engine_and_floating_point_follow_the_reference():
    model = _turning()
    z, u = drawn(model, 3, steps=30)
    for numerics in (FixedSpecification(width=32), FloatSpecification(exponent=8, mantissa=23)):
        design = Design(name="turning", model=model, algorithm="extended", numerics=numerics)
        simulation = design.simulate(z, u)
        np.testing.assert_allclose(simulation.exact.x, simulation.reference.x, atol=0.05)


@pytest.mark.skipif(not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", SUITED)
def test_the_verilog_takes_the_inputs_as_the_engine_does(kind):
    model = random_varying_model(np.random.default_rng(11), 2, 2)
    design = Design(
        name="timed",
        model=model,
        algorithm=kind,
        numerics=FixedSpecification(width=14),
        architecture=Architecture(channels=2, interval=2),
        target=Target(device="unit", grade=1),
    )
    hardware = compile_design(design)
    ports = {port.signal for port in hardware.interface.numbers}
    assert {f"u[{k}]" for k in range(model.p)} <= ports
    z, u = drawn(model, 5)
    runs = verify(hardware, 2000, plots_from_arrays(z, model, u))
    assert [run.stimulus for run in runs] == ["data", "model", "random"]
    assert all(run.mismatches == 0 for run in runs)
