"""The papers' architectures beside ours: what they may cost, and that they are what the table says."""

from dataclasses import replace

import pytest

from kalmanhdl.pipeline import numbers_of, planned
from kalmanhdl.reproduce import kumar2014_hardware, liu2007_hardware
from kalmanhdl.reproduce.hardware import COLUMNS, Built, Candidate, built, table
from kalmanhdl.reproduce.papers import PAPERS, hardware

# Clocks of a step, and multipliers, at most.
LIMITS = {"16 bits, Taylor about I": (78, 24), "16 bits, Bierman-Thornton": (578, 24)}


def scheduled(candidate: Candidate):
    return planned(candidate.design, numbers_of(candidate.design))


@pytest.mark.parametrize("candidate", liu2007_hardware.candidates(), ids=lambda c: c.name)
def test_a_filter_of_liu2007_takes_fewer_clocks_on_fewer_multipliers_than_the_papers(candidate):
    plan, (clocks, multipliers) = scheduled(candidate), LIMITS[candidate.name]
    assert plan.interval <= clocks
    assert plan.sharing.counts["multiply"] <= multipliers


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
    assert [paper for paper in PAPERS if paper not in ("kumar2014", "liu2007") and hardware(paper)] == []


@pytest.mark.slow
def test_a_candidate_is_verified_and_placed():
    first = kumar2014_hardware.candidates()[-2]
    target = replace(first.design.target, seeds=1)
    (found,) = built([replace(first, design=replace(first.design, target=target))])
    assert isinstance(found, Built)
    assert found.bits > 0
    assert found.nanoseconds == pytest.approx(1000 * found.interval / found.placed.fmax_mhz)
    told = table("title", [found], ())
    assert dict(zip(COLUMNS, told.rows[0], strict=True))["multipliers"] == str(found.placed.multipliers)
