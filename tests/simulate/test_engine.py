"""The compiled engine gives, bit for bit, what the definition gives."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest
from conftest import Builder, radar
from random_graphs import random_graph, random_inputs

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import DataError, FormatError
from kalmanhdl.simulate.engine import Engine, Trace, engines


def interpreted(engine: Engine) -> Engine:
    """The same engine as on a machine without a C compiler."""
    return replace(engine, library=None)


def assert_same(one: Trace, other: Trace, active: np.ndarray) -> None:
    for name, values in one.outputs.items():
        assert np.array_equal(values[active], other.outputs[name][active]), name
    for name, values in one.states.items():
        assert np.array_equal(values, other.states[name]), name
        assert np.array_equal(one.final_state[name], other.final_state[name]), name
    assert one.saturations == other.saturations
    assert one.violations == other.violations
    assert one.extremes == other.extremes


def check(seeds: range, minimum_bits: int, operations: int = 14) -> None:
    graphs = [random_graph(Random(seed), operations) for seed in seeds]
    for seed, engine in zip(seeds, engines(graphs, minimum_bits), strict=True):
        inputs, flags, active, state = random_inputs(Random(seed), engine.typed, 9, 5)
        check_one(engine, seed, operations, inputs, flags, active, state)


def check_one(engine, seed, operations, inputs, flags, active, state) -> None:
    for monitor in (True, False):
        arguments = {"active": active, "initial_state": state, "monitor": monitor}
        compiled = engine.run(inputs, flags, **arguments)
        try:
            assert_same(compiled, interpreted(engine).run(inputs, flags, **arguments), active)
        except AssertionError as error:
            raise AssertionError(f"random_graph(Random({seed}), {operations})") from error


@pytest.mark.parametrize("minimum_bits", [0, 64, 128, 700])
def test_compiled_and_interpreted_engine_agree_on_random_graphs(minimum_bits):
    check(range(12 if minimum_bits else 30), minimum_bits)


@pytest.mark.parametrize("minimum_bits", [0, 128])
def test_steps_without_starts_and_misses_agree_too(minimum_bits):
    seeds, shape = range(40, 60), (6, 35)
    for seed, engine in zip(
        seeds, engines([random_graph(Random(s)) for s in seeds], minimum_bits), strict=True
    ):
        inputs, flags, active, state = random_inputs(Random(seed), engine.typed, *shape)
        for name, array in flags.items():
            array[1:] = name != "initialise"
            array[3, 20] ^= True
        check_one(engine, seed, 14, inputs, flags, active | (np.arange(6)[:, None] > 2), state)


@pytest.mark.parametrize("given", [np.int8, np.int16, np.int32, np.int64, object])
def test_inputs_may_be_integers_of_any_size(given):
    engine = Engine.of(radar())
    z = {f"z[{axis}]": np.random.default_rng(8).integers(-100, 100, (7, 37)) for axis in range(2)}
    flags = {"initialise": np.arange(7)[:, None] < np.ones(37, int)}
    active = np.random.default_rng(9).random((7, 37)) < 0.9
    found = engine.run({name: array.astype(given) for name, array in z.items()}, flags, active=active)
    assert_same(found, engine.run(z, flags, active=active), active)
    assert_same(found, interpreted(engine).run(z, flags, active=active), active)


def test_where_long_code_is_cut_makes_no_difference(monkeypatch):
    monkeypatch.setattr("kalmanhdl.simulate.chunks.CHUNK", 7)
    check(range(100, 108), 0)


@pytest.mark.slow
@pytest.mark.parametrize("batch", range(2))
def test_compiled_and_interpreted_engine_agree_on_many_random_graphs(batch):
    check(range(1000 + 40 * batch, 1040 + 40 * batch), 0, 24)


def test_tracks_do_not_mix_and_blocks_have_no_seams():
    engine = Engine.of(radar())
    random = np.random.default_rng(3)
    z = {f"z[{axis}]": random.integers(-30_000, 30_000, (12, 301)) for axis in range(2)}
    flags = {"initialise": np.arange(12)[:, None] < np.full(301, 1)}
    whole = engine.run(z, flags)
    for track in (0, 127, 128, 255, 256, 300):
        alone = {name: values[:, track : track + 1] for name, values in z.items()}
        part = engine.run(alone, {"initialise": flags["initialise"][:, track : track + 1]})
        for name, values in part.states.items():
            assert np.array_equal(values[:, 0], whole.states[name][:, track])


def test_a_run_goes_on_from_the_state_of_another():
    engine = Engine.of(radar())
    z = {f"z[{axis}]": np.random.default_rng(4).integers(-9000, 9000, (10, 3)) for axis in range(2)}
    flags = {"initialise": np.arange(10)[:, None] < np.ones(3, int)}
    whole = engine.run(z, flags)
    first = engine.run({k: v[:4] for k, v in z.items()}, {k: v[:4] for k, v in flags.items()})
    second = engine.run(
        {k: v[4:] for k, v in z.items()},
        {k: v[4:] for k, v in flags.items()},
        initial_state=first.final_state,
    )
    for name, values in whole.final_state.items():
        assert np.array_equal(values, second.final_state[name])
    assert sum(whole.saturations.values()) == sum((*first.saturations.values(), *second.saturations.values()))


def test_an_inactive_step_keeps_the_state_and_counts_nowhere():
    engine = Engine.of(radar())
    z = {f"z[{axis}]": np.full((3, 2), 32767) for axis in range(2)}
    flags = {"initialise": np.zeros((3, 2), bool)}
    active = np.array([[True, False]] * 3)
    trace = engine.run(z, flags, active=active, monitor=True)
    assert trace.states["x[0]"][:, 0].any()
    assert not any(values[:, 1].any() for values in trace.states.values())
    assert (
        trace.saturations
        == engine.run({k: v[:, :1] for k, v in z.items()}, {"initialise": np.zeros((3, 1), bool)}).saturations
    )


@pytest.fixture(scope="module")
def small() -> Engine:
    b = Builder()
    z = b.input("z[0]", Fixed(width=8, fraction=0))
    b.states["x[0]"] = b.quantise(
        b.add(z, b.state("x[0]", Fixed(width=8, fraction=0))), Fixed(width=8, fraction=0)
    )
    b.outputs["y"] = z
    return Engine.of(b.typed())


@pytest.mark.parametrize("raw", [128, -129, 1 << 16, -(1 << 63), (1 << 63) - 1])
@pytest.mark.parametrize("track", [1, 17, 36])
def test_an_input_outside_its_format_is_named_with_step_and_limits(small, raw, track):
    z = np.zeros((4, 37), int)
    z[2, track] = raw
    for engine in (small, interpreted(small)):
        with pytest.raises(FormatError, match=rf"z\[0\], step 2, track {track}: raw {raw} .* -128 to 127"):
            engine.run({"z[0]": z}, {})


def test_an_input_outside_its_format_is_no_matter_where_the_track_has_no_step(small):
    trace = small.run({"z[0]": np.array([[999], [5]])}, {}, active=np.array([[False], [True]]))
    assert trace.final_state["x[0]"].tolist() == [5]


def test_arrays_that_do_not_match_are_refused(small):
    with pytest.raises(DataError, match=r"z\[0\]: the step needs it"):
        small.run({}, {})
    with pytest.raises(DataError, match=r"active: shape \(3, 1\)"):
        small.run({"z[0]": np.zeros((2, 1), int)}, {}, active=np.ones((3, 1), bool))
    with pytest.raises(DataError, match="float64"):
        small.run({"z[0]": np.zeros((2, 1))}, {})
    with pytest.raises(DataError, match=r"x\[0\]: initial state of shape \(3,\)"):
        small.run({"z[0]": np.zeros((2, 1), int)}, {}, initial_state={"x[0]": np.zeros(3, int)})


def test_a_state_counts_what_it_saturates(small):
    trace = small.run({"z[0]": np.full((3, 2), 100)}, {}, monitor=True)
    assert trace.states["x[0]"].tolist() == [[100, 100], [127, 127], [127, 127]]
    assert list(trace.saturations.values()) == [4]
    assert max(trace.largest.values()) == 127


def test_without_a_c_compiler_the_engine_is_slow_but_the_same(monkeypatch):
    monkeypatch.setattr("kalmanhdl.simulate.engine.find_compiler", lambda: None)
    slow = Engine.of(radar())
    monkeypatch.undo()
    fast = Engine.of(radar())
    assert (slow.compiled, fast.compiled) == (False, True)
    z = {f"z[{axis}]": np.random.default_rng(5).integers(-32768, 32768, (6, 2)) for axis in range(2)}
    flags, active = {"initialise": np.arange(6)[:, None] < np.ones(2, int)}, np.ones((6, 2), bool)
    assert_same(slow.run(z, flags, monitor=True), fast.run(z, flags, monitor=True), active)


@pytest.mark.parametrize(
    ("width", "signed", "dtype"),
    [
        (8, True, "int16"),
        (16, True, "int16"),
        (16, False, "uint16"),
        (17, False, "int32"),
        (32, False, "uint32"),
        (64, True, "int64"),
        (64, False, "object"),
    ],
)
def test_results_are_the_narrowest_integers_that_hold_their_format(width, signed, dtype):
    b, form = Builder(), Fixed(width=width, fraction=0, signed=signed)
    b.states["x[0]"] = b.outputs["y"] = b.input("z[0]", form)
    ends = [[form.lowest, form.highest]] * 3
    trace = Engine.of(b.typed()).run({"z[0]": np.array(ends, dtype=object)}, {})
    for values in (trace.outputs["y"], trace.states["x[0]"]):
        assert values.dtype == dtype
        assert values.tolist() == ends


def test_large_results_do_not_overlap():
    engine = Engine.of(radar())
    random = np.random.default_rng(6)
    z = {f"z[{axis}]": random.integers(-9000, 9000, (2000, 301)) for axis in range(2)}
    flags = {"initialise": np.arange(2000)[:, None] < np.full(301, 1)}
    whole = engine.run(z, flags)
    assert sum(values.nbytes for values in (*whole.outputs.values(), *whole.states.values())) > 1 << 23
    part = engine.run({k: v[:, 7:9] for k, v in z.items()}, {k: v[:, 7:9] for k, v in flags.items()})
    for name, values in part.states.items():
        assert np.array_equal(values, whole.states[name][:, 7:9]), name
    for name, values in part.outputs.items():
        assert np.array_equal(values, whole.outputs[name][:, 7:9]), name
