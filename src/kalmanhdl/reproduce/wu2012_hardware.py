"""The hardware of wu2012: the paper's operators, and as few as its update needs within 250 clocks.

Wu, Wang & Ji 2012, section 4: single precision, an adder of 7 clocks and a multiplier of 5, a module for each
part of the filter, whose operators take turns. Here an operator is shared by the whole filter.
"""

from collections import Counter

from kalmanhdl.algorithm import Converted
from kalmanhdl.design import Architecture, Design, Target
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.pipeline import Progress, silent
from kalmanhdl.reproduce.facts import facts
from kalmanhdl.reproduce.hardware import Candidate, Ours, Quoted, built, counted, table
from kalmanhdl.reproduce.reproduction import Reproduction
from kalmanhdl.reproduce.wu2012 import paper_model

_TARGET = Target(device="ecp5-85k", grade=8, seeds=1)
_STEPS = 200


def paper_operators() -> dict[str, int]:
    """The paper's operators of each kind: those of all modules."""
    found = Counter[str]()
    for module in facts("wu2012")["hardware"]["modules"]:
        found.update(module["operators"])
    return dict(found)


def candidates() -> tuple[Candidate, ...]:
    """The paper's operators and a reciprocal unit; and those that suffice for a result in 250 clocks."""
    clocks = facts("wu2012")["hardware"]["clocks"]
    kinds = {
        "the paper's operators": Architecture(
            units={**paper_operators(), "reciprocal": 1}, clocks=clocks, clock_mhz=120
        ),
        "few operators": Architecture(
            units={"add": 5, "multiply": 5, "reciprocal": 1},
            clocks=clocks,
            interval=220,
            latency=250,
            clock_mhz=130,
        ),
    }
    return tuple(
        Candidate(name=f"single precision, {name}", design=_design(architecture), steps=_STEPS, place=False)
        for name, architecture in kinds.items()
    )


def _design(architecture: Architecture) -> Design:
    return Design(
        name="wu2012_single",
        model=paper_model(),
        algorithm=Converted(),
        numerics=FloatSpecification(exponent=8, mantissa=23, subnormals=False),
        architecture=architecture,
        target=_TARGET,
    )


def figures(progress: Progress = silent) -> tuple[Ours, ...]:
    """All candidates, built."""
    return built(candidates(), progress)


def reproduction(found: tuple[Ours, ...]) -> Reproduction:
    """The paper's row, then those of ``figures``."""
    printed = facts("wu2012")["hardware"]
    quoted = [
        Quoted(
            name=row["name"],
            figures={"operators that are shared": counted(paper_operators()), **row["figures"]},
        )
        for row in printed["rows"]
    ]
    modules = "; ".join(
        f"{module['name']} {counted(module['operators'])}, {module['latency']} clocks"
        for module in printed["modules"]
    )
    notes = (f"Operators counted from the paper's section 4.2: {modules}.", *printed["notes"])
    return table("Wu, Wang & Ji 2012: hardware of the tracking filter", (*quoted, *found), notes)
