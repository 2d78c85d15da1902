"""Filters compiled to programs: engine and simulator agree on every bit, and both follow the reference."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from kalmanhdl.algorithm import BiermanThornton, Conventional, Extended, Joseph, Scheduled, Sequential, Taylor
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import ProgramError
from kalmanhdl.model.initial import given, two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.processor.compiler.evaluate import Engine
from kalmanhdl.processor.compiler.generate import compiled, fitting, rows_read, source, tokens
from kalmanhdl.processor.compiler.trace import traced
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import Opcode, decode
from kalmanhdl.processor.peripherals import (
    BenchSink,
    BenchSource,
    HandshakingSink,
    HandshakingSource,
    bench,
)
from kalmanhdl.processor.simulator import Machine, run
from kalmanhdl.simulate.commands import commands, started
from kalmanhdl.simulate.reference import reference

CORE = Core(form=Fixed(width=32, fraction=18), extended=True)
FOUR = Core(form=Fixed(width=32, fraction=18), extended=True, size=4)
OVERLAPPING = Core(form=Fixed(width=32, fraction=18), extended=True, size=4, units=4)
POSITION = linear_model(
    [[1, 1], [0, 1]],
    [[1, 0]],
    [[0.25, 0.5], [0.5, 1]],
    [[9.0]],
    initial=two_point(),
    offset=[0.5, 0.0],
    measurement_offset=[-2.0],
)
SINGER = linear_model(
    [[1, 1, 0.5], [0, 1, 1], [0, 0, 0.8]],
    [[1, 0, 0], [0, 1, 0]],
    np.diag([0.01, 0.1, 0.5]),
    [[9.0, 0], [0, 1.0]],
    initial=given([0, 0, 0], np.diag([100.0, 10, 10])),
)
WHOLE = linear_model(
    [[0.9, 0.1, 0.0], [0.0, 0.8, 0.2], [0.1, 0.0, 0.7]],
    np.eye(3),
    np.eye(3),
    [[4.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 4.0]],
    initial=given([1, 2, 3], 4 * np.eye(3)),
)
TRACKS = linear_model(
    np.kron(np.eye(2), [[1, 1], [0, 1]]),
    np.kron(np.eye(2), [[1, 0]]),
    np.kron(np.eye(2), [[0.25, 0.5], [0.5, 1]]),
    np.diag([9.0, 4.0]),
    initial=two_point(),
)
MIXED = linear_model(
    [[0.95, 0.1, 0, 0.05], [-0.1, 0.95, 0.05, 0], [0, 0.05, 0.9, 0.1], [0.05, 0, -0.1, 0.9]],
    [[1, 0.2, 0, 0.1], [0.1, 1, 0.2, 0], [0, 0.1, 1, 0.2], [0.2, 0, 0.1, 1]],
    0.1 * np.eye(4),
    0.5 * np.eye(4),
    initial=given(np.zeros(4), np.eye(4)),
)
STEERED = linear_model(
    [[1, 1], [0, 0.9]],
    [[1, 0]],
    [[0.05, 0.1], [0.1, 0.25]],
    [[4.0]],
    B=[[0.5, 0.0], [1.0, 0.25]],
    initial=given([0, 0], np.diag([10.0, 5.0])),
)
CERTAIN = linear_model(
    np.eye(2), np.eye(2), np.diag([0.1, 0]), np.eye(2), initial=given([0, 0], np.diag([1.0, 0]))
)
ALGORITHMS = (
    Conventional(),
    Joseph(),
    Sequential(),
    BiermanThornton(),
    Scheduled(steps=0),
    Taylor("initial"),
    Taylor("initial", newton=2),
)
CASES = [(POSITION, CORE), (SINGER, CORE), (TRACKS, FOUR), (WHOLE, CORE), (MIXED, FOUR), (MIXED, OVERLAPPING)]


def measurements(model, steps=60):
    rng = np.random.default_rng(model.n + model.m)
    z = np.cumsum(rng.normal(size=(steps, model.m)), axis=0) + np.arange(steps)[:, None] * 0.1
    z[20] = z[31, 0] = z[33:36] = z[40, -1] = np.nan
    return z


def outputs(filter_, core, z, machine):
    """What simulator and engine put out: rows of x and the diagonal of P, raw."""
    rows = rows_read(core, z)
    engine = Engine(filter_, core)
    wanted = np.array([engine.step(row) for row in rows])
    program = compiled(filter_, core)
    machine.source, machine.sink = bench(core, tokens(filter_, core, rows))
    machine.load(program.words)
    done = run(machine, 1_000_000)
    assert done.reason == "the input is exhausted"
    assert not machine.saturated
    assert not engine.saturated
    return np.array(done.sent).reshape(len(z), -1), wanted


def followed(model, algorithm, z):
    cube = z[:, None]
    issued = commands(model, cube, np.ones(cube.shape[:2], bool))
    found = reference(algorithm(model), issued, cube, np.zeros((len(z), 1, 0)))
    return found.x[:, 0], found.P[:, 0], started(model, issued)[:, 0]


@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda a: f"{a.kind}{getattr(a, 'newton', '')}")
@pytest.mark.parametrize(
    ("model", "core"),
    CASES,
    ids=["position", "two of three", "two tracks", "all of three", "four of four", "four of four, pipelined"],
)
def test_a_compiled_filter_is_the_engine_and_follows_the_reference(model, core, algorithm):
    inverts = algorithm.kind in ("conventional", "joseph") and model.m > 1
    z = measurements(model)
    if algorithm.kind == "taylor":
        # Behind a longer gap the expansion diverges, in double precision too.
        z[33:36] = z[32]
    got, wanted = outputs(
        traced(model, algorithm, core.size), core, z, Machine(core, BenchSource(()), BenchSink())
    )
    np.testing.assert_array_equal(got, wanted)
    x, P, running = followed(model, algorithm, z)
    reals = got[running] * 2.0**-18
    # A determinant and its reciprocal have fewer digits than a pivot.
    np.testing.assert_allclose(reals[:, : model.n], x[running], atol=2e-2 if inverts else 2e-3)
    variances = P[running][:, range(model.n), range(model.n)]
    np.testing.assert_allclose(reals[:, model.n :], variances, atol=5e-2 if inverts else 1e-2)


@pytest.mark.parametrize(
    "algorithm", [Conventional(), BiermanThornton(), Scheduled(steps=0)], ids=lambda a: a.kind
)
def test_controls_move_the_mean(algorithm):
    z = measurements(STEERED)[:40]
    u = np.random.default_rng(4).normal(size=(40, 2))
    filter_ = traced(STEERED, algorithm, 3)
    rows = rows_read(CORE, z, u)
    engine = Engine(filter_, CORE)
    wanted = [number for row in rows for number in engine.step(row)]
    machine = Machine(CORE, BenchSource(tokens(filter_, CORE, rows)), BenchSink())
    machine.load(compiled(filter_, CORE).words)
    assert list(run(machine, 1_000_000).sent) == wanted
    issued = commands(STEERED, z[:, None], np.ones((40, 1), bool))
    found = reference(algorithm(STEERED), issued, z[:, None], u[:, None])
    means = np.array(wanted).reshape(40, -1)[:, :2] * 2.0**-18
    np.testing.assert_allclose(means, found.x[:, 0], atol=1e-3)


@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda a: f"{a.kind}{getattr(a, 'newton', '')}")
@pytest.mark.parametrize(
    ("model", "core"),
    [(POSITION, CORE), (SINGER, CORE), (TRACKS, FOUR), (WHOLE, CORE), (MIXED, OVERLAPPING)],
    ids=["position", "two of three", "two tracks", "all of three", "four of four, pipelined"],
)
def test_loops_in_a_program_do_the_same(model, core, algorithm):
    z = measurements(model)[:45]
    if algorithm.kind == "taylor":
        z[33:36] = z[32]
    filter_ = traced(model, algorithm, core.size, short=True)
    got, wanted = outputs(filter_, core, z, Machine(core, BenchSource(()), BenchSink()))
    np.testing.assert_array_equal(got, wanted)
    x, P, running = followed(model, algorithm, z)
    reals = got[running] * 2.0**-18
    inverts = algorithm.kind in ("conventional", "joseph") and model.m > 1
    np.testing.assert_allclose(reals[:, : model.n], x[running], atol=2e-2 if inverts else 2e-3)
    variances = P[running][:, range(model.n), range(model.n)]
    np.testing.assert_allclose(reals[:, model.n :], variances, atol=5e-2 if inverts else 1e-2)


@pytest.mark.parametrize("short", [False, True], ids=["fast", "loops"])
@pytest.mark.parametrize("algorithm", [Sequential(), BiermanThornton()], ids=lambda a: a.kind)
def test_measurements_in_correlated_groups_are_taken_one_by_one_whatever_is_missed(algorithm, short):
    R = np.array([[1.0, 0, 0.8, 0], [0, 0.5, 0, -0.3], [0.8, 0, 2.0, 0], [0, -0.3, 0, 0.4]])
    model = replace(MIXED, R=R)
    z = measurements(model, 48)
    z[12:28] += 3.0
    for missed in range(16):
        z[12 + missed, [bool(missed >> k & 1) for k in range(4)]] = np.nan
    filter_ = traced(model, algorithm, 4, short=short)
    got, wanted = outputs(filter_, OVERLAPPING, z, Machine(OVERLAPPING, BenchSource(()), BenchSink()))
    np.testing.assert_array_equal(got, wanted)
    x, P, _ = followed(model, algorithm, z)
    np.testing.assert_allclose(got[:, :4] * 2.0**-18, x, atol=2e-4)
    variances = P[:, range(4), range(4)]
    np.testing.assert_allclose(got[:, 4:] * 2.0**-18, variances, atol=2e-4)


def dense(n, m):
    rng = np.random.default_rng(n + m)
    F = 0.9 * np.linalg.qr(rng.normal(size=(n, n)))[0]
    H = rng.normal(size=(m, n)) / 4
    return linear_model(F, H, 0.1 * np.eye(n), np.eye(m), initial=given(np.zeros(n), np.eye(n)))


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda a: f"{a.kind}{getattr(a, 'newton', '')}")
@pytest.mark.parametrize("units", [0, 16])
def test_sixteen_states_and_measurements_fit_the_paper_s_store(algorithm, units):
    core = Core(form=Fixed(width=32, fraction=20), extended=True, size=16, units=units)
    filter_ = fitting(dense(16, 16), algorithm, core)
    assert len(compiled(filter_, core).words) <= 512


def test_a_program_that_is_too_long_is_made_with_loops():
    core = Core(form=Fixed(width=32, fraction=20), extended=True, size=8, units=8)
    assert not fitting(dense(8, 4), Sequential(), core).shared
    filter_ = fitting(dense(8, 4), BiermanThornton(), core)
    assert [block.times for block in filter_.row(9)] == [1, 8, 1, 4, 1]
    text = source(filter_, core)
    assert "rows_pass:" in text
    assert text.count("JUMP_U   update") == 1


def test_what_is_kept_tells_the_whole_covariance():
    filter_, z = traced(MIXED, BiermanThornton(), 4), measurements(MIXED)[:12]
    engine = Engine(filter_, FOUR)
    for row in rows_read(FOUR, z):
        engine.step(row)
    numbers = {name: np.reshape(raw, (4, 4)) * 2.0**-18 for name, raw in engine.stored.items()}
    x, P = filter_.estimate(numbers)
    means, covariances, _ = followed(MIXED, BiermanThornton(), z)
    np.testing.assert_allclose(x, means[-1], atol=1e-3)
    np.testing.assert_allclose(P, covariances[-1], atol=1e-3)
    np.testing.assert_array_equal(P, P.T)


def test_filters_follow_each_other_in_one_machine():
    machine = Machine(CORE, BenchSource(()), BenchSink())
    for model in (SINGER, POSITION, WHOLE, POSITION):
        got, wanted = outputs(traced(model, Conventional(), 3), CORE, measurements(model), machine)
        np.testing.assert_array_equal(got, wanted)


def test_slow_peripherals_change_nothing_but_the_time():
    z, filter_ = measurements(POSITION)[:25], traced(POSITION, Conventional(), 3)
    read = tokens(filter_, CORE, rows_read(CORE, z))
    slow = Machine(
        CORE,
        HandshakingSource(read, [17] * len(read), [3] * len(read)),
        HandshakingSink([41, 0, 9], [1, 0, 4]),
    )
    slow.load(compiled(filter_, CORE).words)
    done = run(slow, 1_000_000)
    wanted = outputs(filter_, CORE, z, Machine(CORE, BenchSource(()), BenchSink()))[1]
    assert done.sent == tuple(wanted.ravel())


def test_the_program_says_what_each_instruction_is():
    text = source(traced(POSITION, Conventional(), 3), CORE)
    assert "RECIP    _t1 _v" in text or "-- update: 1 / S" in text
    assert "SYMSUB_33" in text
    assert text.count("JUMP_U") == 1


def test_dense_constants_are_read_in_loops_and_thin_ones_element_by_element():
    text = source(traced(MIXED, Conventional(), 4), OVERLAPPING)
    assert "read_F_row:     READ     0 F" in text
    assert "SUB_33   F F F" not in text
    assert text.count("LOOP ") == 2 * text.count("_column:")
    thin = source(traced(POSITION, Conventional(), 3), CORE)
    assert "LOOP" not in thin


def test_what_is_known_is_not_computed():
    identity = linear_model(np.eye(2), np.eye(2), np.eye(2), np.eye(2), initial=given([0, 0], np.eye(2)))
    words = compiled(traced(identity, Sequential(), 3), CORE).words
    step = [decode(word).opcode for word in words]
    # F x and F P F' are x and P; what is left of the prediction is one sum.
    assert Opcode.MULT_31 not in step
    assert [step.count(each) for each in (Opcode.MSUB_31, Opcode.MADD_31)] == [2 * 2, 2 * 2]
    assert [step.count(each) for each in (Opcode.ADD_33, Opcode.SYMADD_33)] == [1, 2 * 2]


@pytest.mark.parametrize(
    ("model", "algorithm", "core", "message"),
    [
        (
            TRACKS,
            Conventional(),
            CORE,
            "4 states do not fit the core's matrices of 3 by 3: take a larger core",
        ),
        (POSITION, Extended(), CORE, 'kind = "extended" has no program: choose conventional'),
        (POSITION, Scheduled(steps=5), CORE, "for the steady gain alone: write steps = 0"),
        (CERTAIN, BiermanThornton(), CORE, "that of x1 comes to zero"),
    ],
)
def test_what_has_no_program_is_refused(model, algorithm, core, message):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ProgramError, match=message):
            traced(model, algorithm, core.size)


def test_a_constant_that_is_no_number_of_the_core_is_refused():
    for form in (Fixed(width=8, fraction=6), Fixed(width=16, fraction=1)):
        core = Core(form=form, extended=True)
        with pytest.raises(ProgramError, match=r"the constant .* of .* is no number of fixed"):
            Engine(traced(POSITION, Conventional(), 3), core)


def test_a_store_that_is_too_small_is_refused():
    small = Core(form=Fixed(width=32, fraction=18), extended=True, matrices=8)
    with pytest.raises(ProgramError, match="matrices and the data store has 8: enlarge it"):
        compiled(traced(POSITION, Conventional(), 3), small)
