"""The register bits that a report tells of, against the registers of the Verilog."""

import re
from pathlib import Path

import pytest

from kalmanhdl import pipeline
from kalmanhdl.design_file.reader import load
from kalmanhdl.schedule.lifetimes import widths
from kalmanhdl.schedule.summary import summarise

_DESIGNS = Path(__file__).parents[2] / "designs"
_COPY = re.compile(r"^\s*reg (?:signed )?(?:\[(\d+):0\] )?(\S+_c\d+)(?: = .*)?;", re.M)


@pytest.mark.parametrize("name", ["kumar2014_time_multiplexed", "lee1997_one_track", "nile"])
def test_values_that_wait_take_the_registers_that_are_told(name: str):
    design = load(_DESIGNS / f"{name}.toml")
    hardware = pipeline.compile_design(design)
    clocked = set(re.findall(r"(\S+_c\d+) <=", hardware.verilog))
    built = sum(
        int(highest or 0) + 1
        for highest, copy in _COPY.findall(hardware.verilog)
        if copy in clocked and not copy.startswith(("valid_", "track_", "command_"))
    )
    told = summarise(hardware.plan, design.target.part).register_bits
    # Yosys leaves out bits that nothing reads.
    assert 0.8 * told <= built <= told


def test_operations_that_take_turns_share_the_registers_of_their_operator():
    design = load(_DESIGNS / "kumar2014_time_multiplexed.toml")
    plan = pipeline.planned(design, pipeline.numbers_of(design))
    bits = summarise(plan, design.target.part).operator_register_bits
    held = [count * width for count, width in zip(plan.registers, widths(plan.typed), strict=True)]
    shared = {index for unit in plan.units for index in unit.operations}
    apart = sum(bits for index, bits in enumerate(held) if index not in shared)
    assert apart < bits <= apart + sum(max(held[k] for k in unit.operations) for unit in plan.units)
    assert bits < sum(held) / 2
