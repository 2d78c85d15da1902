"""The vectors of a test bench: what is sent, and what the bit-exact engine says must come out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.rtl.interface import Interface
from kalmanhdl.schedule.plan import Plan
from kalmanhdl.simulate.engine import Engine, Trace
from kalmanhdl.simulate.limbs import Integers
from kalmanhdl.testbench.sections import Section, handed_over, of_stream
from kalmanhdl.verify.border import sent_numbers, tag
from kalmanhdl.verify.stimulus import Steps

Pauses = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Transfers:
    """Tokens of one stream in one section, in their order: what every port carries, as raw integers.

    ``pauses`` are the clocks between a token and the one before it in which it is not offered, or not taken.
    ``clocks`` are those after reset in which they must be taken, where that is known.
    """

    section: str
    stream: str
    pauses: Pauses
    numbers: dict[str, Integers]
    clocks: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Vectors:
    """Everything that is sent and expected, section by section and stream by stream."""

    sections: tuple[Section, ...]
    stimulus: tuple[Transfers, ...]
    expected: tuple[Transfers, ...]


def vectors(
    plan: Plan, shown: Interface, engine: Engine, wanted: Sequence[Section], seed: int = 1
) -> Vectors:
    """The vectors of sections that run one after the other, of a design whose states start at zero."""
    random = np.random.default_rng(seed)
    stimulus, expected = list[Transfers](), list[Transfers]()
    state: dict[str, Integers] | None = None
    for section in wanted:
        steps = section.steps
        trace = engine.run(
            steps.inputs, steps.flags, active=steps.active, initial_state=state, record_states=False
        )
        state = trace.final_state
        for number, prefix in enumerate(shown.streams):
            own = of_stream(steps, shown, number)
            stimulus.append(_sent(section, prefix, shown, own, random))
            if not section.dropped:
                expected.append(_results(section, prefix, plan, shown, own, trace, random))
    return Vectors(sections=tuple(wanted), stimulus=tuple(stimulus), expected=tuple(expected))


def _sent(
    section: Section, prefix: str, shown: Interface, steps: Steps, random: np.random.Generator
) -> Transfers:
    pauses = _pauses(section.pause, len(steps.order), random)
    numbers = sent_numbers(steps, shown)
    return Transfers(section=section.name, stream=prefix, pauses=pauses, numbers=numbers)


def _results(
    section: Section,
    prefix: str,
    plan: Plan,
    shown: Interface,
    steps: Steps,
    trace: Trace,
    random: np.random.Generator,
) -> Transfers:
    numbers = tag(steps, shown, "out")
    numbers |= {port.name: trace.outputs[port.signal].ravel()[steps.order] for port in shown.outputs}
    pauses = _pauses(section.pause, len(steps.order), random)
    pauses[:1] += section.held
    return Transfers(
        section=section.name,
        stream=prefix,
        pauses=pauses,
        numbers=numbers,
        clocks=handed_over(steps, plan, shown) if section.calm else None,
    )


def _pauses(often: float, count: int, random: np.random.Generator) -> Pauses:
    """Clocks of pause before each of so many tokens; another clock is added with the same probability."""
    return random.geometric(1 - often, count) - 1
