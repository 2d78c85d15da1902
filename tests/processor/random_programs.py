"""Programs, operands and peripherals drawn at random."""

from kalmanhdl.processor.core import LOOPS, Core
from kalmanhdl.processor.instructions import OPERATIONS, Kind, Opcode, build, encode
from kalmanhdl.processor.rtl_simulation import Peripherals


def number(rng, core):
    """Any raw number, the ends of the format and small ones more often."""
    form = core.form
    if core.floating:
        return float_number(rng, form)
    kind = rng.random()
    if kind < 0.1:
        return rng.choice((form.lowest, form.highest, 0, 1, -1))
    if kind < 0.5:
        scale = 1 << rng.randrange(form.width)
        return max(form.lowest, min(form.highest, rng.randint(-scale, scale)))
    return rng.randint(form.lowest, form.highest)


def float_number(rng, form):
    """Any bits, the ends, zeros, NaN and subnormals more often, and numbers near each other most often."""
    kind, sign = rng.random(), rng.choice((0, form.sign))
    if kind < 0.12:
        return sign | rng.choice((0, 1, form.highest, form.infinity, form.nan, 1 << form.mantissa))
    if kind < 0.2:
        return sign | rng.randrange(1 << form.mantissa)
    if kind < 0.8:
        exponent = max(1, min((1 << form.exponent) - 2, form.bias + rng.randint(-3, 3)))
        return sign | exponent << form.mantissa | rng.randrange(1 << form.mantissa)
    return rng.getrandbits(form.width)


def every_instruction(core: Core) -> list[int]:
    """Reads two matrices, does all arithmetic on them, writes one element, and begins again."""
    a, b, c = 0, core.matrices // 2, core.matrices - 1
    program = [build(Opcode.READ, element, matrix) for matrix in (a, b) for element in range(core.elements)]
    for operation in OPERATIONS.values():
        if core.has(operation.opcode) and operation.operands[-1:] == (DESTINATION,):
            program += _arithmetic(operation, core, a, b, c)
    program += [build(Opcode.WRITE, c, core.elements - 1), build(Opcode.NOP), build(Opcode.JUMP_U, 0)]
    return [encode(instruction) for instruction in program]


DESTINATION = OPERATIONS["ADD_33"].operands[-1]


def _arithmetic(operation, core, a, b, c):
    """An instruction with all that its operands can be, but matrices."""
    kinds = [operand.kind for operand in operation.operands]
    match kinds:
        case [Kind.MATRIX, Kind.MATRIX, Kind.MATRIX]:
            return [build(operation.opcode, a, b, c)]
        case [Kind.MATRIX, Kind.MATRIX]:
            return [build(operation.opcode, a, c)]
        case [Kind.MATRIX, kind, Kind.MATRIX]:
            return [build(operation.opcode, a, each, c) for each in core.allowed(kind)]
        case _:
            return []


def random_program(rng, core: Core, length: int) -> list[int]:
    """Any instructions, on a few matrices; jumps within the program, and loops in loops."""
    matrices = [rng.randrange(core.matrices) for _ in range(5)]
    halts = rng.random() < 0.1
    choices = [
        operation
        for operation in OPERATIONS.values()
        if core.has(operation.opcode)
        and operation.opcode not in (Opcode.LOOP, Opcode.NEXT)
        and (halts or operation.opcode is not Opcode.HALT)
    ]
    body, inside = [], []
    _fill(rng, core, choices, length, (), body, inside)
    words = []
    for operation, place in zip(body, inside, strict=True):
        operands = []
        for operand in operation.operands:
            if operand.kind is Kind.MATRIX:
                operands.append(rng.choice(matrices))
            elif operand.kind is Kind.COUNT:
                operands.append(rng.randint(1, 4))
            elif operation.opcode is Opcode.NEXT:
                operands.append(place[-1])
            elif operand.kind is Kind.TARGET:
                operands.append(rng.choice([k for k, other in enumerate(inside) if other == place]))
            else:
                operands.append(rng.choice(core.allowed(operand.kind)))
        words.append(encode(build(operation.opcode, *operands)))
    return words


def _fill(rng, core, choices, length, place, body, inside):
    """Operations of so many words; ``place``: the starts of the loops that they stand in."""
    end = len(body) + length
    while len(body) < end:
        room = end - len(body)
        if core.extended and room >= 3 and len(place) < LOOPS and rng.random() < 0.08:
            body.append(OPERATIONS["LOOP"])
            inside.append(place)
            inner = (*place, len(body))
            _fill(rng, core, choices, rng.randint(1, room - 2), inner, body, inside)
            body.append(OPERATIONS["NEXT"])
            inside.append(inner)
        else:
            body.append(rng.choice(choices))
            inside.append(place)


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
