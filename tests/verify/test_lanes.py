"""Several filters side by side: bit for bit, in order and to the clock, whichever way the streams lead."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kalmanhdl.design import Architecture, Design, Streams, Target
from kalmanhdl.errors import KalmanhdlError
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import compile_design, verify
from kalmanhdl.rtl.interface import interface
from kalmanhdl.simulate.data import plots_from_arrays
from kalmanhdl.verify.clocks import clocks_of
from kalmanhdl.verify.sharing import shared_flow
from kalmanhdl.verify.timing import handed_over
from verify.test_timing import plan_of

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("g++", "clang++", "c++"))), reason="no C++ compiler"
)


def hardware_of(**architecture):
    model = linear_model(
        [[1.0, 1.0], [0.0, 1.0]], [[1.0, 0.0]], np.diag([0.0, 0.3]), [[2.0]], initial=two_point()
    )
    return compile_design(
        Design(
            name="axis",
            model=model,
            numerics=FixedSpecification(width=12),
            architecture=Architecture(**architecture),
            target=Target(device="unit", grade=1),
        )
    )


@pytest.fixture(scope="module")
def shared():
    return hardware_of(interval=2, channels=3, lanes=3)


@pytest.fixture(scope="module")
def apart():
    return hardware_of(interval=1, channels=3, lanes=2, streams=Streams.LANE)


@needs_compiler
@pytest.mark.parametrize("kind", ["shared", "apart"])
def test_lanes_are_equal_bit_for_bit_and_clock_for_clock(kind, request):
    hardware = request.getfixturevalue(kind)
    z = np.cumsum(np.random.default_rng(1).standard_normal((20, 7, 1)), axis=0)
    runs = verify(hardware, 4000, plots_from_arrays(z, hardware.design.model))
    assert [run.stimulus for run in runs] == ["data", "model", "random"]
    assert sum(run.steps for run in runs) == 4000 + 20 * 7
    assert all(run.mismatches == 0 for run in runs)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    "architecture",
    [
        {"interval": 1, "channels": 1, "lanes": 4},
        {"interval": 3, "channels": 5, "lanes": 2},
        {"interval": 2, "channels": 8, "lanes": 5},
        {"interval": None, "channels": 1, "lanes": 3, "streams": Streams.LANE},
    ],
    ids=str,
)
def test_any_number_of_lanes_with_any_interval(architecture):
    assert sum(run.mismatches for run in verify(hardware_of(**architecture), 3000)) == 0


@needs_compiler
def test_results_of_lanes_that_are_mixed_up_are_found(shared):
    wrong, changed = re.subn(r"(assign order__ready = )", r"\1 1'h0 & ", shared.verilog, count=1)
    assert changed
    with pytest.raises(KalmanhdlError, match="stuck"):
        verify(replace(shared, verilog=wrong), 100)
    module = re.search(r"module \\axis\.order .*?endmodule", shared.verilog, re.DOTALL)[0]
    swapped = re.sub(r"assign o__payload = (.*);", r"assign o__payload = \1 ^ 2'h1;", module)
    assert swapped != module
    with pytest.raises(KalmanhdlError, match=r"axis: (step|the simulated design is stuck)"):
        verify(replace(shared, verilog=shared.verilog.replace(module, swapped)), 400)


def test_a_track_lives_in_the_lane_of_its_number(shared, apart):
    assert shared.interface.track_width == 4
    assert [shared.interface.track_id(t) for t in range(5)] == [0b0000, 0b0001, 0b0010, 0b0100, 0b0101]
    assert [apart.interface.track_id(t) for t in range(5)] == [0, 0, 1, 1, 2]


def test_the_verilog_has_a_lane_once_and_tells_of_its_ports(shared, apart):
    assert shared.verilog.count("module axis_lane(") == 1
    assert len(re.findall(r"^  axis_lane lane_\d \(", shared.verilog, re.MULTILINE)) == 3
    assert "Lanes: 3" in shared.verilog
    assert "lane_0_in_valid to lane_1_in_valid" in apart.verilog
    assert {"lane_0_in_z_0", "lane_1_out_x_1"} <= set(re.findall(r"\w+", apart.verilog))


@pytest.mark.parametrize(("streams", "fed"), [("one", 3), ("lane", 5)])
def test_a_shared_stream_feeds_no_more_lanes_than_the_interval(streams, fed):
    assert Architecture(interval=3, lanes=5, streams=streams).lanes_fed(3) == fed


@pytest.fixture(scope="module")
def plan():
    return plan_of(channels=3, interval=2, distance=5)


@settings(deadline=None)
@given(tracks=st.lists(st.integers(0, 2), min_size=1, max_size=60))
def test_one_lane_with_shared_streams_is_a_filter_two_clocks_later(plan, tracks):
    _, handed = shared_flow(plan, 1, np.array(tracks))
    alone = handed_over(plan, np.array(tracks))
    # A slot of two clocks: a step that comes one clock later starts two clocks later.
    assert set((handed - alone).tolist()) <= {1, 2, 3}


@settings(deadline=None)
@given(tracks=st.lists(st.integers(0, 11), min_size=1, max_size=80), lanes=st.integers(2, 4))
def test_lanes_take_and_give_in_order_and_no_faster_than_they_may(plan, tracks, lanes):
    accepted, handed = shared_flow(plan, lanes, np.array(tracks))
    assert (np.diff(accepted) >= 1).all()
    assert (np.diff(handed) >= 1).all()
    assert (handed - accepted > 5).all()


def test_as_many_lanes_as_the_interval_give_a_result_a_clock(plan):
    _, handed = shared_flow(plan, 2, np.arange(60) % 6)
    assert set(np.diff(handed[10:]).tolist()) == {1}


@pytest.mark.parametrize(("lanes", "gap"), [(1, 0), (3, 1)])
def test_lanes_hold_back_as_many_steps_as_all_of_them_do(plan, lanes, gap):
    entrance, exit_ = 2, 2
    # A lane whose steps come one by one leaves a place empty between those that wait.
    each = clocks_of(plan, interface(plan)).held_back - gap
    assert (
        replace(clocks_of(plan, interface(plan, 2)), lanes=lanes).held_back == lanes * each + entrance + exit_
    )
