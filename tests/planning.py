"""Schedules for tests: an operator for every operation unless told otherwise."""

from collections.abc import Mapping

from kalmanhdl.numerics.typed import TypedGraph
from kalmanhdl.schedule.modulo import schedule
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.schedule.wanted import Wanted
from kalmanhdl.target.device import Device


def planned(
    typed: TypedGraph,
    device: Device,
    interval: int | None,
    channels: int,
    clock_mhz: float | None = None,
    multiplier_blocks: int | None = None,
    units: Mapping[str, int] | None = {},
) -> Plan:
    return schedule(
        typed,
        device,
        Wanted(
            interval=interval,
            channels=channels,
            clock_mhz=clock_mhz,
            multiplier_blocks=multiplier_blocks,
            units=units,
        ),
    )
