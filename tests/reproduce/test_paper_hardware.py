"""The papers' architectures beside ours: what they may cost, and that they are what the table says."""

from dataclasses import replace

import pytest

from kalmanhdl.pipeline import numbers_of, planned
from kalmanhdl.reproduce import kumar2014_hardware, liu2007_hardware
from kalmanhdl.reproduce.hardware import (
    COLUMNS,
    Built,
    Candidate,
    Estimated,
    Software,
    built,
    table,
)
from kalmanhdl.reproduce.papers import PAPERS, hardware
from kalmanhdl.schedule.summary import summarise
from kalmanhdl.target import device

# Clocks of a step of the paper's; its multiplier blocks are 96 and 110, of which a quarter must do.
CLOCKS = {"16 bits, Taylor about I": 78, "16 bits, Bierman-Thornton": 578}
MULTIPLIERS = 24


def scheduled(candidate: Candidate):
    return planned(candidate.design, numbers_of(candidate.design))


@pytest.mark.parametrize("candidate", liu2007_hardware.candidates(), ids=lambda c: c.name)
def test_a_filter_of_liu2007_takes_fewer_clocks_on_fewer_multipliers_than_the_papers(candidate):
    plan, target = scheduled(candidate), candidate.design.target
    assert plan.interval <= CLOCKS[candidate.name]
    assert summarise(plan, device(target.device, target.grade)).multiplier_blocks <= MULTIPLIERS


@pytest.mark.parametrize("candidate", kumar2014_hardware.candidates(), ids=lambda c: c.name)
def test_a_half_of_kumar2014_shares_its_operators_and_a_parallel_one_has_its_own(candidate):
    plan, units = scheduled(candidate), candidate.design.architecture.units
    if units is None:
        assert plan.interval == 1
        assert not plan.units
    else:
        assert all(
            plan.sharing.counts[kind] <= most for kind, most in units.items() if kind in plan.sharing.counts
        )


def test_only_papers_with_hardware_have_a_table_of_it():
    built = ("kumar2014", "liu2007", "wu2012")
    assert [paper for paper in PAPERS if paper not in built and hardware(paper)] == []


@pytest.mark.slow
def test_a_candidate_is_verified_and_placed():
    first = kumar2014_hardware.candidates()[-2]
    target = replace(first.design.target, seeds=1)
    (found,) = built([replace(first, design=replace(first.design, target=target))])
    assert isinstance(found, Built)
    assert found.bits > 0
    estimated = Estimated(name="not placed", plan=found.plan, bits=1, cells=(5, 4, 3, 2))
    told = table("title", [found, estimated, Software(name="other", seconds_per_step=2e-6)], ())
    placed, expected, other = (dict(zip(COLUMNS, row, strict=True)) for row in told.rows)
    assert placed["multipliers"] == str(found.placed.multipliers)
    nanoseconds = 1000 * found.plan.interval / found.placed.fmax_mhz
    assert float(placed["ns a step"]) == pytest.approx(nanoseconds, abs=0.05)
    assert float(expected["MHz"]) == pytest.approx(1000 / found.plan.period_ns, abs=0.05)
    assert "estimate" in expected["architecture"]
    assert (other["ns a step"], other["M steps/s"], other["MHz"]) == ("2000", "0.5", "")
