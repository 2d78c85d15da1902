"""The hardware of kumar2014: parallel and time-multiplexed, 12 and 32 bits, and ours for the same task.

Kumar & Aggarwal 2014, tables of section 5: 18 adders, 10 subtractors, 12 multipliers and 4 dividers in
parallel; time-multiplexed, range in odd clocks and bearing in even ones, on half of them.
"""

from dataclasses import replace

from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision, TableNewton
from kalmanhdl.arithmetic.fixed import Overflow
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.hardware import Candidate, Ours, Quoted, built, table
from kalmanhdl.reproduce.kumar2014 import paper_design, paper_model, radar_model
from kalmanhdl.reproduce.reproduction import Reproduction

_TARGET = Target(device="ecp5-25k", grade=8, seeds=2)
# Of Q12.20 products need several multiplier blocks each.
_LARGE = Target(device="ecp5-85k", grade=8, seeds=2)
_RADIX_2, _RADIX_4 = LongDivision(radix=2), LongDivision(radix=4)
_TABLE = TableNewton(index_bits=7, iterations=0)
_PARALLEL = Architecture(interval=1)
# What the paper shares, operators of each kind at most.
_HALF = {"add": 9, "subtract": 5, "multiply": 6, "reciprocal": 2}


def candidates() -> tuple[Candidate, ...]:
    """The paper's architectures with its dividers in 12 and in 32 bits, and then ours in 12 bits."""
    shared = Architecture(units=_HALF)
    few = Architecture(units={"multiply": 5, "reciprocal": 1})
    many = Architecture(interval=1, channels=20)
    made = {
        "12 bits, parallel, radix 2": _short(_RADIX_2, _PARALLEL),
        "12 bits, parallel, radix 4": _short(_RADIX_4, _PARALLEL),
        "12 bits, half the operators, radix 2": _short(_RADIX_2, shared),
        "12 bits, half the operators, radix 4": _short(_RADIX_4, shared),
        "32 bits, parallel, radix 2": _long(_RADIX_2, _PARALLEL),
        "32 bits, parallel, radix 4": _long(_RADIX_4, _PARALLEL),
        "32 bits, half the operators, radix 4": _long(_RADIX_4, shared),
        "12 bits, parallel, table": _single_cycle(),
        "12 bits, five multipliers, one table": _short(_TABLE, few),
        "12 bits, pipelined, table": _short(_TABLE, many),
    }
    return tuple(Candidate(name=name, design=design) for name, design in made.items())


def _long(division: DivisionMethod, architecture: Architecture) -> Design:
    design = paper_design(paper_model())
    numerics = replace(design.fixed_point, division=division)
    return replace(design, numerics=numerics, architecture=architecture, target=_LARGE)


def _short(division: DivisionMethod, architecture: Architecture) -> Design:
    # A constant of 17 bits fits a multiplier block with its sign.
    numerics = FixedSpecification(width=12, classes={"constant": 17}, division=division)
    return Design(
        name="kumar2014",
        model=radar_model(),
        numerics=numerics,
        architecture=architecture,
        target=_TARGET,
    )


def _single_cycle() -> Design:
    """As designs/lee1997_single_cycle.toml: nothing saturates, F is wires, 1 / S is looked up whole."""
    T = facts("kumar2014")["lee1997"]["T"]
    numerics = FixedSpecification(
        width=12,
        classes={"innovation_covariance": 10},
        overflow=Overflow.WRAP,
        coast=2,
        scale=(2.0**18, 2.0**13 / T, 2.0**3, 2.0**-3 / T),
        division=TableNewton(index_bits=9, iterations=0),
    )
    return replace(_short(_TABLE, _PARALLEL), numerics=numerics)


def figures(progress: Progress = silent) -> tuple[Ours, ...]:
    """All candidates, built."""
    return built(candidates(), progress)


def reproduction(found: tuple[Ours, ...]) -> Reproduction:
    """The paper's rows, then those of ``figures``."""
    printed = facts("kumar2014")["hardware"]
    quoted = [Quoted(name=row["name"], figures=row["figures"]) for row in printed["rows"]]
    return table(
        "Kumar & Aggarwal 2014: hardware of the radar filter", (*quoted, *found), tuple(printed["notes"])
    )
