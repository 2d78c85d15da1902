"""The disassembler: any words become a source that assembles to the same words."""

from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.assembler import RAW_WORD
from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import FUNCTIONS, Instruction, Kind, decode


def disassemble(words: tuple[int, ...], core: Core) -> str:
    """A source with a label at every target of a jump; what is no instruction of the core stays a word."""
    instructions = [_instruction(word, core) for word in words]
    targets = {
        value
        for instruction in instructions
        if instruction is not None
        for operand, value in zip(instruction.operation.operands, instruction.operands, strict=True)
        if operand.kind is Kind.TARGET and value < len(words)
    }
    lines = [".text"]
    for address, (word, instruction) in enumerate(zip(words, instructions, strict=True)):
        label = f"L{address}:" if address in targets else ""
        code = f"{RAW_WORD} 0x{word:08X}" if instruction is None else _text(instruction, targets)
        lines.append(f"{label:<8}{code}".rstrip())
    return "\n".join(lines) + "\n"


def _instruction(word: int, core: Core) -> Instruction | None:
    try:
        instruction = decode(word)
        fits = all(
            value in core.allowed(operand.kind)
            for operand, value in zip(instruction.operation.operands, instruction.operands, strict=True)
        )
        return instruction if fits and core.has(instruction.opcode) else None
    except ProgramError:
        return None


def text_of(word: int) -> str:
    """One word as an instruction, without labels; Raises ProgramError where it is none."""
    return _text(decode(word), set())


def _text(instruction: Instruction, targets: set[int]) -> str:
    operands = zip(instruction.operation.operands, instruction.operands, strict=True)
    shown = [_operand(each.kind, value, targets) for each, value in operands]
    return f"{instruction.opcode.name:<12}{' '.join(f'{operand:<7}' for operand in shown)}".rstrip()


def _operand(kind: Kind, value: int, targets: set[int]) -> str:
    if kind is Kind.TARGET and value in targets:
        return f"L{value}"
    return FUNCTIONS[value].value if kind is Kind.FUNCTION and value < len(FUNCTIONS) else str(value)
