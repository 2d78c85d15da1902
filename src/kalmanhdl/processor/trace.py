"""What a run says of itself: every instruction with its operands and results as real numbers."""

from kalmanhdl.processor.clocks import Retired
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.disassembler import text_of
from kalmanhdl.processor.instructions import Kind, Opcode, encode
from kalmanhdl.processor.program import Program
from kalmanhdl.processor.simulator import Machine


def trace_line(done: Retired, machine: Machine, program: Program) -> str:
    """One line for an instruction that has just retired: its clock, address, text and effect."""
    text = text_of(encode(done.instruction))
    label = next((name for name, address in program.labels.items() if address == done.address), "")
    place = f"{label}:" if label else ""
    return f"{done.clock + 1:8d}  {done.address:3d}  {place:<10} {text:<34} {_effect(done, machine)}".rstrip()


def _effect(done: Retired, machine: Machine) -> str:
    core = machine.core
    if done.sent is not None:
        return f"out {real(done.sent, core)}"
    if done.elements:
        flag = "  saturated" if done.saturated else ""
        return f"{_operands(done)}= {_numbers(done, core)}{flag}"
    if any(operand.kind is Kind.TARGET for operand in done.instruction.operation.operands):
        return f"to {machine.address}"
    return ""


def _operands(done: Retired) -> str:
    if done.instruction.opcode in (Opcode.READ, Opcode.PLACE, Opcode.RECIP):
        return f"{done.matrix}[{done.elements.start}] "
    return f"{done.matrix} "


def _numbers(done: Retired, core: Core) -> str:
    return " ".join(real(value, core) for value in done.values)


def real(raw: int, core: Core) -> str:
    """A raw number as the shortest decimal that is this double."""
    return repr(float(core.numbers.reals([raw])[0]))


def dump(machine: Machine, program: Program) -> str:
    """The matrices of the data store that are not zero, under their names, row after row."""
    core, names = machine.core, dict[int, str]()
    for name, address in program.matrices.items():
        names.setdefault(address, name)
    rows = []
    for address, matrix in enumerate(machine.data):
        if any(matrix):
            rows.append(f"{names.get(address, '')} ({address})".strip())
            for start in range(0, core.elements, core.size):
                rows.append("  " + "  ".join(real(raw, core) for raw in matrix[start : start + core.size]))
    return "\n".join(rows)
