"""The simulator and the Verilog side by side: every instruction, every bit, every clock."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from kalmanhdl.errors import VerificationError
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.disassembler import text_of
from kalmanhdl.processor.instructions import encode
from kalmanhdl.processor.peripherals import (
    BenchSink,
    BenchSource,
    HandshakingSink,
    HandshakingSource,
    Sink,
    Source,
)
from kalmanhdl.processor.rtl_simulation import Peripherals, Records, RtlSimulation
from kalmanhdl.processor.simulator import Machine, Retired

FLAGS = ("ACK_I", "DRDY_O", "DRDY_I", "ACK_O", "saturated")


def source_of(peripherals: Peripherals) -> Source:
    """The source of the simulator."""
    if peripherals.latencies is None:
        return BenchSource(peripherals.tokens)
    return HandshakingSource(peripherals.tokens, peripherals.latencies, peripherals.reactions)


def sink_of(peripherals: Peripherals) -> Sink:
    """The sink of the simulator."""
    if peripherals.sink_latencies is None:
        return BenchSink()
    return HandshakingSink(peripherals.sink_latencies, peripherals.sink_reactions)


def recorded(machine: Machine, instructions: int) -> tuple[Records, list[Retired]]:
    """What the simulator says of so many instructions, as the hardware's records."""
    core = machine.core
    done, flags, out = [], np.zeros((instructions, len(FLAGS)), bool), np.zeros(instructions, np.int64)
    elements = np.zeros((instructions, core.elements), bool)
    values = np.zeros((instructions, core.elements), np.int64)
    for k in range(instructions):
        machine.settle()
        flags[k] = (
            machine.acknowledge,
            machine.ready,
            machine.source.ready,
            machine.sink.taken,
            machine.saturated,
        )
        out[k] = machine.data_out
        retired = machine.retire()
        written = slice(retired.elements.start, retired.elements.stop)
        elements[k, written] = True
        values[k, written] = retired.values
        done.append(retired)
    records = Records(
        clock=np.array([each.clock for each in done], np.int64),
        address=np.array([each.address for each in done], np.int64),
        flags=flags,
        data_out=out,
        elements=elements,
        values=values,
    )
    return records, done


def compare(
    core: Core,
    rtl: RtlSimulation,
    machine: Machine,
    words: Sequence[int],
    peripherals: Peripherals,
    instructions: int,
) -> int:
    """Run a program on both and compare every instruction; how many values were equal.

    Both keep their data stores from run to run. Raises VerificationError that names the first difference.
    """
    machine.source, machine.sink = source_of(peripherals), sink_of(peripherals)
    machine.load(tuple(words))
    rtl.load(words, peripherals)
    expected, done = recorded(machine, instructions)
    found = rtl.run(instructions)
    values = np.where(expected.elements, found.values, 0)
    pairs = (
        ("clock", expected.clock, found.clock),
        ("address", expected.address, found.address),
        *((name, expected.flags[:, k], found.flags[:, k]) for k, name in enumerate(FLAGS)),
        ("data_out", expected.data_out, found.data_out),
        ("elements written", expected.elements, found.elements),
        ("values written", expected.values, values),
    )
    wrong = {name: int(np.argmax(_differs(a, b))) for name, a, b in pairs if _differs(a, b).any()}
    if wrong:
        name = min(wrong, key=lambda each: wrong[each])
        at = wrong[name]
        wanted, got = next((a[at], b[at]) for each, a, b in pairs if each == name)
        instruction = text_of(encode(done[at].instruction))
        raise VerificationError(
            f"instruction {at}, {instruction} at address {done[at].address}, clock {done[at].clock}: "
            f"{name} is {_shown(got)} in the Verilog and {_shown(wanted)} in the simulator"
        )
    return sum(a.size for _, a, _ in pairs)


def _differs(a: Any, b: Any) -> Any:
    different = a != b
    return different.any(axis=1) if different.ndim == 2 else different


def _shown(value: Any) -> str:
    return str(value.tolist())
