"""What a schedule is asked for."""

from collections.abc import Mapping
from dataclasses import dataclass

from kalmanhdl.design import SOLVER_SECONDS
from kalmanhdl.errors import ScheduleError


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """How fast steps follow each other, and on what.

    A step starts every ``interval`` cycles, one of the same track after ``channels`` steps of others. None
    for ``interval`` is the least. Operators are pipelined for ``clock_mhz``, the device's own pipelined
    period without one. At most ``multiplier_blocks`` blocks multiply, the rest is logic.

    ``units`` limits the operators of a kind, whose operations then take turns. Without it an interval of more
    than one cycle, or a ``latency`` that is allowed, is met with few operators; else there are as many as
    operations. Where a list schedule of theirs misses its bounds a solver looks for a better one for
    ``solver_seconds``, which it counts the same on any machine. Those of ``iterative``
    kinds work for several cycles on one operation.
    """

    interval: int | None = None
    channels: int = 1
    clock_mhz: float | None = None
    multiplier_blocks: int | None = None
    units: Mapping[str, int] | None = None
    latency: int | None = None
    iterative: tuple[str, ...] = ()
    solver_seconds: float = SOLVER_SECONDS


def refused(key: str, problem: str) -> ScheduleError:
    """The error that says why a key of [architecture] cannot be met."""
    return ScheduleError(f"architecture.{key}{problem}", table="architecture", key=key)
