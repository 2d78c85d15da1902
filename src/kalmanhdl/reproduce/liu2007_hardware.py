"""The hardware of liu2007: Taylor and Bierman-Thornton filters of four states and measurements, 16 bits.

Liu, Bouganis & Cheung 2007, tables 1 and 2. The paper gives no model; this is the dense one of ``liu2007``.
"""

from kalmanhdl.algorithm import BiermanThornton, Taylor
from kalmanhdl.algorithm.filter import Algorithm
from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.hardware import Built, Candidate, Quoted, built, table
from kalmanhdl.reproduce.liu2007 import chosen_model
from kalmanhdl.reproduce.reproduction import Reproduction

_TARGET = Target(device="ecp5-85k", grade=8, seeds=2)
_UNITS = {"multiply": 24, "reciprocal": 1}
_TRACKS = 16


def candidates() -> tuple[Candidate, ...]:
    """Each filter on 24 multipliers, for one track and for many that take turns."""
    kinds: dict[str, Algorithm] = {
        "Taylor about I": Taylor(about="identity"),
        "Bierman-Thornton": BiermanThornton(),
    }
    return tuple(
        Candidate(name=f"16 bits, {name}", design=_design(algorithm, tracks))
        for name, algorithm in kinds.items()
        for tracks in (1, _TRACKS)
    )


def _design(algorithm: Algorithm, tracks: int) -> Design:
    return Design(
        name="liu2007",
        model=chosen_model(),
        algorithm=algorithm,
        numerics=FixedSpecification(width=16, division=TableNewton(index_bits=7, iterations=1)),
        architecture=Architecture(units=_UNITS, channels=tracks),
        target=_TARGET,
    )


def figures(progress: Progress = silent) -> tuple[Built, ...]:
    """All candidates, built."""
    return built(candidates(), progress)


def reproduction(found: tuple[Built, ...]) -> Reproduction:
    """The paper's rows, then those of ``figures``."""
    printed = facts("liu2007")["hardware"]
    quoted = [Quoted(name=row["name"], figures=row["figures"]) for row in printed["rows"]]
    return table(
        "Liu, Bouganis & Cheung 2007: hardware, n = m = 4", (*quoted, *found), tuple(printed["notes"])
    )
