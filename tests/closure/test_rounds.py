"""Rounds of scheduling and placing: the clock that is asked for is reached where latency can buy it."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from placer import Placer, hop, placed

from kalmanhdl.closure import rounds
from kalmanhdl.closure.rounds import close
from kalmanhdl.design import Design
from kalmanhdl.design_file import dumps, loads
from kalmanhdl.errors import DesignError, ToolError
from kalmanhdl.pipeline import Implemented, compile_design, numbers_of, planned, realised, verify

DESIGNS = Path(__file__).parents[2] / "designs"


@pytest.fixture(autouse=True)
def _without_verilog(monkeypatch):
    """The stand-in for the tools reads the plan, so that Yosys need not write Verilog of every round."""
    monkeypatch.setattr("kalmanhdl.pipeline.verilog_of", lambda design, plan: "")


@cache
def numbers(name):
    return numbers_of(Design.load(DESIGNS / f"{name}.toml"))


def hardware(name, mhz, count=4, **architecture):
    design = Design.load(DESIGNS / f"{name}.toml")
    target = replace(design.target, rounds=count)
    asked = replace(design.architecture, clock_mhz=mhz, **architecture)
    design = replace(design, architecture=asked, target=target)
    found = numbers(name)
    return realised(design, found, planned(design, found))


def test_a_clock_that_is_reached_at_once_takes_one_round():
    placer = Placer({})
    found = close(hardware("lee1997", 100.0), place=placer)
    assert len(placer.plans) == len(found.closure.rounds) == 1
    assert found.closure.stopped == "the clock is reached"
    assert found.hardware.design.target.rounds == 0
    assert found.hardware.design.target.derate == {}


@pytest.mark.parametrize(("kind", "factor"), [("reciprocal", 1.5), ("quantise", 1.9), ("add", 1.9)])
def test_latency_is_given_to_what_was_slow_until_the_clock_is_reached(kind, factor):
    # Slower than the table promises, but no piece alone is too long for a stage.
    found = close(hardware("lee1997", 120.0, channels=64), place=Placer({kind: factor}))
    first, last = found.closure.rounds[0], found.closure.rounds[-1]
    assert first.reached_mhz < 120 <= last.reached_mhz
    assert found.closure.kept == len(found.closure.rounds) - 1
    assert kind in found.hardware.design.target.derate
    assert last.latency_cycles > first.latency_cycles
    assert found.closure.stopped == "the clock is reached"


def test_a_slow_shared_operator_is_cut_off_from_what_follows():
    before = hardware("kumar2014_time_multiplexed", 150.0)
    found = close(before, place=Placer({"reciprocal": 1.3}))
    first, last = found.closure.rounds
    assert first.critical[0].kind == "reciprocal"
    assert found.closure.stopped == "the clock is reached"
    # The clocks were there: what followed in the same one now begins in the next.
    assert (last.interval_cycles, last.latency_cycles) == (first.interval_cycles, first.latency_cycles)
    assert found.hardware.plan.start != before.plan.start


def test_one_track_keeps_what_is_soonest_where_latency_costs_more_than_it_gives():
    placer = Placer({"reciprocal": 1.6})
    found = close(hardware("nile", 150.0), place=placer)
    kept = found.closure.rounds[found.closure.kept]
    assert kept.step_ns == min(one.step_ns for one in found.closure.rounds)
    assert "with more latency a step takes" in found.closure.stopped
    assert found.hardware.plan is placer.plans[found.closure.kept]


def test_the_rounds_that_were_asked_for_are_the_most():
    placer = Placer({"quantise": 4.0, "add": 4.0, "subtract": 4.0, "select": 4.0})
    found = close(hardware("lee1997", 190.0, count=2, channels=64), place=placer)
    assert len(placer.plans) == 3
    assert found.closure.stopped == "2 rounds were asked for"


def test_an_interval_that_leaves_no_clocks_is_said():
    found = close(hardware("lee1997_single_cycle", 100.0), place=Placer({}))
    assert len(found.closure.rounds) == 1
    assert "the interval of 1 leaves the loop of the states no more clocks" in found.closure.stopped


def test_a_latency_that_is_given_is_kept():
    free = hardware("kumar2014_time_multiplexed", 150.0)
    latency = free.plan.latency
    held = hardware("kumar2014_time_multiplexed", 150.0, latency=latency)
    found = close(held, place=Placer({"reciprocal": 1.8}))
    assert found.hardware.plan.latency <= latency
    assert f"architecture.latency is {latency}" in found.closure.stopped


def test_a_path_in_the_streams_ends_the_rounds():
    path = (hop("clk-to-q", "entrance.full", 0.5), hop("setup", "credits.count_TRELLIS_FF_Q", 9.5))

    def place(hardware, progress):
        return Implemented(placements=(placed(100.0, path),), seconds={})

    assert "runs through no operator" in close(hardware("nile", 150.0), place=place).closure.stopped


def test_a_round_that_does_not_fit_leaves_the_one_before():
    placer = Placer({"quantise": 1.9})

    def place(hardware, progress):
        if placer.plans:
            raise ToolError("nextpnr-ecp5: the device is full")
        return placer(hardware, progress)

    found = close(hardware("lee1997", 120.0, channels=64), place=place)
    assert len(found.closure.rounds) == 1
    assert found.closure.stopped.endswith("the device is full")
    assert found.hardware.design.target.derate == {}


def test_the_first_placement_must_succeed():
    def place(hardware, progress):
        raise ToolError("nextpnr-ecp5: the device is full")

    with pytest.raises(ToolError, match="the device is full"):
        close(hardware("lee1997", 120.0), place=place)


def test_what_has_all_its_registers_is_not_scheduled_anew(monkeypatch):
    schedules = []
    monkeypatch.setattr(rounds, "planned", lambda *given: schedules.append(given) or planned(*given))
    # One piece of the reciprocal alone takes longer than the clock.
    found = close(hardware("lee1997", 180.0, channels=64), place=Placer({"reciprocal": 3.0}))
    assert "reciprocal (update: K[1,0] term): it has its stages for itself" in found.closure.stopped
    assert len(schedules) <= 2


def test_the_closed_design_gives_the_same_schedule_again():
    found = close(hardware("lee1997", 120.0, channels=64), place=Placer({"quantise": 1.9}))
    again = loads(dumps(found.hardware.design))
    assert again.target == found.hardware.design.target
    assert planned(again, numbers("lee1997")).start == found.hardware.plan.start


def test_rounds_need_a_clock():
    design = Design.load(DESIGNS / "nile.toml")
    with pytest.raises(
        DesignError, match=r"rounds = 3: say which clock they are to reach: architecture\.clock_mhz"
    ):
        replace(design, target=replace(design.target, rounds=3))


def test_seconds_are_those_of_all_rounds():
    found = close(hardware("lee1997", 120.0, channels=64), place=Placer({"quantise": 1.9}))
    assert found.implemented.seconds["place_and_route"] == len(found.closure.rounds) > 1


@pytest.mark.slow
def test_rounds_with_the_real_tools(monkeypatch):
    monkeypatch.undo()
    design = Design.load(DESIGNS / "kumar2014_time_multiplexed.toml")
    design = replace(
        design,
        architecture=replace(design.architecture, clock_mhz=200.0),
        target=replace(design.target, seeds=1, rounds=2),
    )
    found = rounds.close(compile_design(design))
    first, kept = found.closure.rounds[0], found.closure.rounds[found.closure.kept]
    assert len(found.closure.rounds) > 1 or found.closure.stopped != "the clock is reached"
    assert kept.step_ns <= first.step_ns
    assert found.implemented.best.fmax_mhz == kept.reached_mhz
    assert all(run.mismatches == 0 for run in verify(found.hardware, 2000))
