"""As few operators as an interval, a latency or a rate needs."""

from dataclasses import replace

import pytest
from devices import PLAUSIBLE
from graphs import alpha_beta

from kalmanhdl.design import MAX_INTERVAL, Architecture
from kalmanhdl.errors import DesignError, ScheduleError
from kalmanhdl.pipeline import wanted
from kalmanhdl.schedule.checker import problems
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.wanted import Wanted


def test_a_longer_interval_needs_no_more_operators():
    counts = []
    for interval in (12, 16, 24, 48):
        plan = schedule(alpha_beta(), PLAUSIBLE, Wanted(interval=interval))
        assert problems(plan, PLAUSIBLE) == []
        counts.append(plan.sharing.counts.get("multiply", 3))
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 1


def test_a_latency_is_met_or_refused_with_the_least_there_is():
    plan = schedule(alpha_beta(), PLAUSIBLE, Wanted(latency=40))
    assert plan.latency <= 40
    assert plan.sharing.counts["multiply"] == 1
    with pytest.raises(ScheduleError, match=r"latency is 1: with an operator for every operation it is \d+"):
        schedule(alpha_beta(), PLAUSIBLE, Wanted(latency=1))


def test_an_interval_that_the_operators_do_not_allow_says_what_they_do():
    with pytest.raises(ScheduleError, match=r"interval is 2: no schedule on 1 multiply was found"):
        schedule(alpha_beta(), PLAUSIBLE, Wanted(interval=2, units={"multiply": 1}))


def test_a_rate_is_an_interval_of_the_clock_that_is_aimed_at():
    assert wanted(Architecture(updates_per_second=3e6, clock_mhz=100.0), PLAUSIBLE).interval == 33
    with pytest.raises(DesignError, match="updates_per_second"):
        wanted(Architecture(updates_per_second=3e8, clock_mhz=100.0), PLAUSIBLE)


def test_a_rate_asks_for_no_longer_interval_than_may_be_given():
    least = 100e6 * 2 / MAX_INTERVAL
    slowest = Architecture(updates_per_second=least, clock_mhz=100.0, lanes=2)
    assert wanted(slowest, PLAUSIBLE).interval == MAX_INTERVAL
    message = r"^\[architecture\] updates_per_second = 1: an interval of 200000000 clocks follows at"
    with pytest.raises(DesignError, match=rf"{message} 100.0 MHz, and 65536 .*: ask for 3051.76 or more"):
        wanted(replace(slowest, updates_per_second=1.0), PLAUSIBLE)
