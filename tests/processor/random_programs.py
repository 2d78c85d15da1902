"""Programs, operands and peripherals drawn at random."""

from kalmanhdl.processor.core import Core
from kalmanhdl.processor.instructions import OPERATIONS, Kind, Opcode, build, encode
from kalmanhdl.processor.rtl_simulation import Peripherals

JUMPS = (Opcode.JUMP_U, Opcode.JUMP_DRDY, Opcode.JUMP_ACK)
ARITHMETIC = (Opcode.ADD_33, Opcode.MULT_31, Opcode.MULT_33, Opcode.DET_33, Opcode.MULT_3S)


def number(rng, core):
    """Any raw number, the ends of the format and small ones more often."""
    form = core.form
    kind = rng.random()
    if kind < 0.1:
        return rng.choice((form.lowest, form.highest, 0, 1, -1))
    if kind < 0.5:
        scale = 1 << rng.randrange(form.width)
        return max(form.lowest, min(form.highest, rng.randint(-scale, scale)))
    return rng.randint(form.lowest, form.highest)


def every_instruction(core: Core) -> list[int]:
    """Reads two matrices, does all arithmetic on them, writes one element, and begins again."""
    a, b, c = 0, core.matrices // 2, core.matrices - 1
    program = [build(Opcode.READ, element, matrix) for matrix in (a, b) for element in range(core.elements)]
    for opcode in ARITHMETIC:
        sources = (a, b)[: len(OPERATIONS[opcode.name].operands) - 1]
        program.append(build(opcode, *sources, c))
    program += [build(Opcode.WRITE, c, 4), build(Opcode.NOP), build(Opcode.JUMP_U, 0)]
    return [encode(instruction) for instruction in program]


def random_program(rng, core: Core, length: int) -> list[int]:
    """Any instructions, on a few matrices; jumps within the program."""
    matrices = [rng.randrange(core.matrices) for _ in range(5)]
    limits = {Kind.ELEMENT: core.elements, Kind.TARGET: length}
    names = list(OPERATIONS)
    words = []
    for _ in range(length):
        operation = OPERATIONS[rng.choice(names)]
        operands = (
            rng.choice(matrices) if operand.kind is Kind.MATRIX else rng.randrange(limits[operand.kind])
            for operand in operation.operands
        )
        words.append(encode(build(operation.opcode, *operands)))
    return words


def random_peripherals(rng, core: Core, count: int) -> Peripherals:
    """Peripherals with latencies up to many instructions, or a bench on either side."""
    tokens = [number(rng, core) for _ in range(count)]
    slow = rng.choice((0, 5, 40, 200))
    source, sink = rng.random() < 0.8, rng.random() < 0.8
    return Peripherals(
        tokens=tokens,
        latencies=[rng.randint(0, slow) for _ in tokens] if source else None,
        reactions=[rng.randint(0, 4) for _ in tokens],
        sink_latencies=[rng.randint(0, slow) for _ in range(7)] if sink else None,
        sink_reactions=[rng.randint(0, 4) for _ in range(7)],
    )
