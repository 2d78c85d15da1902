"""What an opcode on wires is, and what it writes."""

from collections.abc import Iterable

from amaranth.hdl import Const, Value

from kalmanhdl.processor.core import Core, writes
from kalmanhdl.processor.instructions import Instruction, Opcode

NAMING = (Opcode.READ, Opcode.PLACE, Opcode.RECIP)
"""The instructions that write the element that they name."""


def is_one_of(opcode: Value, core: Core, opcodes: Iterable[Opcode]) -> Value:
    """Whether an opcode is one of several, of which the core has some."""
    found: Value = Const(0)
    for each in sorted(opcodes, key=lambda one: one.value):
        if core.has(each):
            found = found | (opcode == each.value)
    return found


def written(core: Core, opcode: Value, element: int) -> Value:
    """Whether an instruction writes an element, whichever element it names."""
    writing = [
        each
        for each in Opcode
        if core.has(each) and each not in NAMING and element in writes(Instruction(each), core)
    ]
    return is_one_of(opcode, core, writing)


def stores(core: Core, opcode: Value, named: Value, element: int) -> Value:
    """Whether an instruction that names an element writes this one."""
    return written(core, opcode, element) | (is_one_of(opcode, core, NAMING) & (named == element))
