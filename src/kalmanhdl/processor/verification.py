"""The simulator and the Verilog side by side: every instruction, every result, every bit, every clock."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from kalmanhdl.errors import VerificationError
from kalmanhdl.processor.clocks import Event
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.disassembler import text_of
from kalmanhdl.processor.instructions import encode
from kalmanhdl.processor.peripherals import HandshakingSink, HandshakingSource, Sink, Source, bench
from kalmanhdl.processor.rtl_simulation import Peripherals, Records, RtlSimulation
from kalmanhdl.processor.simulator import Machine

FLAGS = ("ACK_I", "DRDY_O", "DRDY_I", "ACK_O", "saturated")


def source_of(peripherals: Peripherals, core: Core) -> Source:
    """The source of the simulator."""
    if peripherals.latencies is None:
        return bench(core, peripherals.tokens)[0]
    return HandshakingSource(peripherals.tokens, peripherals.latencies, peripherals.reactions)


def sink_of(peripherals: Peripherals, core: Core) -> Sink:
    """The sink of the simulator."""
    if peripherals.sink_latencies is None:
        return bench(core, ())[1]
    return HandshakingSink(peripherals.sink_latencies, peripherals.sink_reactions)


def recorded(machine: Machine, instructions: int) -> tuple[Records, list[Event]]:
    """What the simulator says of so many instructions, as the hardware's records.

    They end early with a READ that waits for what never comes.
    """
    core, events = machine.core, list[Event]()
    machine.time.events = events
    for _ in range(instructions):
        if not machine.settle():
            break
        machine.retire()
    machine.time.events = None
    if events and not events[-1].issued:
        last = max((k for k, event in enumerate(events) if event.issued), default=-1)
        del events[last + 1 :]
    elements = np.zeros((len(events), core.elements), bool)
    values = np.zeros((len(events), core.elements), np.int64)
    for k, event in enumerate(events):
        if event.stored:
            written = slice(event.stored.elements.start, event.stored.elements.stop)
            elements[k, written] = True
            values[k, written] = event.stored.values
    records = Records(
        clock=np.array([each.clock for each in events], np.int64),
        issued=np.array([each.issued is not None for each in events], bool),
        address=np.array([each.issued.address if each.issued else 0 for each in events], np.int64),
        flags=np.array([each.flags for each in events], bool).reshape(-1, len(FLAGS)),
        data_out=np.array([each.data_out for each in events], np.int64),
        matrix=np.array([each.stored.matrix if each.stored else 0 for each in events], np.int64),
        elements=elements,
        values=values,
    )
    return records, events


def compare(
    core: Core,
    rtl: RtlSimulation,
    machine: Machine,
    words: Sequence[int],
    peripherals: Peripherals,
    instructions: int,
) -> int:
    """Run a program on both and compare every clock in which one of them does something; how many values.

    Both keep their data stores from run to run. Raises VerificationError that names the first difference.
    """
    machine.source, machine.sink = source_of(peripherals, core), sink_of(peripherals, core)
    machine.load(tuple(words))
    rtl.load(words, peripherals)
    expected, events = recorded(machine, instructions)
    found = rtl.run(int(expected.issued.sum()))
    pairs = tuple(
        (name, a[: len(found.clock)], b[: len(expected.clock)])
        for name, a, b in (
            ("clock", expected.clock, found.clock),
            ("an instruction's start", expected.issued, found.issued),
            ("address", expected.address, np.where(found.issued, found.address, 0)),
            *((name, expected.flags[:, k], found.flags[:, k]) for k, name in enumerate(FLAGS)),
            ("data_out", expected.data_out, found.data_out),
            ("matrix written", expected.matrix, np.where(found.elements.any(axis=1), found.matrix, 0)),
            ("elements written", expected.elements, found.elements),
            ("values written", expected.values, np.where(found.elements, found.values, 0)),
        )
    )
    wrong = {name: int(np.argmax(_differs(a, b))) for name, a, b in pairs if _differs(a, b).any()}
    if wrong:
        name = min(wrong, key=lambda each: wrong[each])
        at = wrong[name]
        wanted, got = next((a[at], b[at]) for each, a, b in pairs if each == name)
        raise VerificationError(
            f"clock {events[at].clock}{_doing(events[at])}: "
            f"{name} is {_shown(got)} in the Verilog and {_shown(wanted)} in the simulator"
        )
    if len(expected.clock) != len(found.clock):
        raise VerificationError(
            f"the Verilog does something in {len(found.clock)} clocks "
            f"and the simulator in {len(expected.clock)}"
        )
    return sum(a.size for _, a, _ in pairs)


def _doing(event: Event) -> str:
    """The instructions of a clock."""
    parts = []
    if event.issued:
        parts.append(f"{text_of(encode(event.issued.instruction))} at address {event.issued.address}")
    if event.stored and event.stored is not event.issued:
        stored = event.stored
        parts.append(f"the result of {text_of(encode(stored.instruction))} at address {stored.address}")
    return "".join(f", {part}" for part in parts)


def _differs(a: Any, b: Any) -> Any:
    different = a != b
    return different.any(axis=1) if different.ndim == 2 else different


def _shown(value: Any) -> str:
    return str(value.tolist())
