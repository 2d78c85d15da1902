"""Builds to report on: the radar filter on real plots, a design of a paper, and the smallest filter."""

from dataclasses import replace

import pytest
from builds import placement, record_of

from kalmanhdl.pipeline import Implemented
from kalmanhdl.report.record import Record
from kalmanhdl.toolchain.area import AreaFigures
from kalmanhdl.verify.compare import Verification


@pytest.fixture(scope="session")
def radar() -> Record:
    """The radar filter with every stage, those of tools made up."""
    area = AreaFigures(
        family="lut4",
        family_name="4-input LUTs",
        tool="yosys of a test",
        luts=4321,
        carry=100,
        ffs=50,
        multipliers=0,
        block_rams=0,
        cells={"$lut": 4321},
    )
    run = Verification(
        simulator="cxxrtl", stimulus="data", steps=584, bits=5840, cycles=600, cycles_per_second=1e6
    )
    return replace(
        record_of("autoferry_radar", "autoferry_radar_target.csv"),
        verifications=(run,),
        implemented=Implemented(
            placements=(placement(2, 160.0), placement(1, 150.0)),
            seconds={"synthesise": 3.0, "place_and_route": 4.0},
        ),
        areas=(area,),
        seconds={"verify": 5.0},
    )


@pytest.fixture(scope="session")
def lee() -> Record:
    """A design named after a paper, before data or tools."""
    return record_of("lee1997", None)


@pytest.fixture(scope="session")
def nile() -> Record:
    """One state, one measurement, no truth."""
    return record_of("nile", "nile.csv")
