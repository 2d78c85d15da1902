"""The hardware of liu2007: Taylor and Bierman-Thornton filters of four states and measurements, 16 bits.

Liu, Bouganis & Cheung 2007, table 2, and the paper's software baseline. The paper gives no model; this is
the dense one of ``liu2007``.
"""

import numpy as np

from kalmanhdl.algorithm import BiermanThornton, Taylor
from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.reproduce import opencv
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.hardware import Candidate, Ours, Quoted, Software, built, table
from kalmanhdl.reproduce.liu2007 import chosen_model, drawn
from kalmanhdl.reproduce.reproduction import Reproduction

_TARGET = Target(device="ecp5-85k", grade=8, seeds=2)
_TRACKS = 16


ALGORITHMS: dict[str, Algorithm] = {
    "Taylor about I": Taylor(about="identity"),
    "Bierman-Thornton": BiermanThornton(),
}
# Of one track few operations are ready at a time: their sums take turns too. A multiplier has a block, the
# reciprocals and the division of the second filter have three.
_ONE_TRACK = {
    "Taylor about I": {"multiply_add": 14, "multiply": 2, "reciprocal": 1},
    "Bierman-Thornton": {"multiply_add": 5, "multiply": 1, "reciprocal": 1},
}
# Slow enough that a product and its sum fit into one clock, which saves more clocks than it costs time.
_CLOCK_MHZ = 80.0
# Of many tracks every multiplier is busy in every clock, and what is added has an adder of its own.
_MANY_TRACKS = {
    "Taylor about I": {"multiply": 24, "reciprocal": 1},
    "Bierman-Thornton": {"multiply": 21, "reciprocal": 1},
}
_SOFTWARE_STEPS = 10_000


def candidates() -> tuple[Candidate, ...]:
    """Each filter on 24 multiplier blocks at the most, for one track and for many that take turns."""
    return tuple(
        Candidate(name=f"16 bits, {name}", design=shared_design(name, tracks=tracks))
        for name in ALGORITHMS
        for tracks in (1, _TRACKS)
    )


def shared_design(
    name: str, *, states: int = 4, width: int = 16, tracks: int = 1, blocks: int | None = None
) -> Design:
    """A filter of ``ALGORITHMS``; multipliers may use so many ``blocks``, where it says."""
    # A constant of 17 bits fits a multiplier block with its sign.
    numerics = FixedSpecification(
        width=width, classes={"constant": 17}, division=TableNewton(index_bits=7, iterations=1)
    )
    return Design(
        name="liu2007",
        model=chosen_model(states),
        algorithm=ALGORITHMS[name],
        numerics=numerics,
        architecture=Architecture(
            units=(_ONE_TRACK if tracks == 1 else _MANY_TRACKS)[name],
            channels=tracks,
            multiplier_blocks=blocks,
            clock_mhz=_CLOCK_MHZ if tracks == 1 else None,
        ),
        target=_TARGET,
    )


def software() -> tuple[Software, ...]:
    """OpenCV's filter of the same model, timed now; none where it is not installed."""
    if not opencv.available():
        return ()
    model = chosen_model()
    plots = drawn(model, np.zeros(model.n), _SOFTWARE_STEPS, 1, 1)
    return tuple(
        Software(
            name=f"OpenCV {run.version}, {run.precision}, here",
            seconds_per_step=run.seconds_per_step,
        )
        for run in opencv.timed(model, plots.z[:, 0])
    )


def figures(progress: Progress = silent) -> tuple[Software | Ours, ...]:
    """The software, timed before anything else runs, and all candidates, built."""
    progress("OpenCV's filter")
    return (*software(), *built(candidates(), progress))


def reproduction(found: tuple[Software | Ours, ...]) -> Reproduction:
    """The paper's rows, then those of ``figures``."""
    printed = facts("liu2007")["hardware"]
    quoted = [Quoted(name=row["name"], figures=row["figures"]) for row in printed["rows"]]
    timed = any(isinstance(entry, Software) for entry in found)
    notes = (*printed["notes"], printed["timed" if timed else "not_timed"])
    return table("Liu, Bouganis & Cheung 2007: hardware, n = m = 4", (*quoted, *found), notes)
