"""The instruction set as data: what each instruction is called, and where its operands stand in the word.

A word has 32 bits: the opcode in the 5 at the top, then three arguments of 9 bits (bhatia2012, figure 16).
"""

from dataclasses import dataclass
from enum import Enum

from kalmanhdl.errors import ProgramError
from kalmanhdl.graph.operations import Function

WORD_BITS = 32
OPCODE_BITS = 5
ARGUMENT_BITS = 9
ARGUMENTS = 3


class Opcode(Enum):
    """The five bits at the top of a word; the codes of the paper's instructions are the paper's."""

    NOP = 0x00
    HALT = 0x01
    LOOP = 0x02
    NEXT = 0x03
    COPY = 0x04
    SCALE = 0x05
    RECIP = 0x06
    PICK = 0x07
    ADD_33 = 0x08
    MULT_31 = 0x09
    MULT_33 = 0x0A
    DET_33 = 0x0B
    MULT_3S = 0x0C
    SUB_33 = 0x0D
    MULT_33T = 0x0E
    TRANS_33 = 0x0F
    READ = 0x10
    WRITE = 0x11
    PLACE = 0x12
    ADJ_33 = 0x13
    JUMP_U = 0x14
    JUMP_DRDY = 0x15
    JUMP_ACK = 0x16
    SYMADD_33 = 0x17
    SYMSUB_33 = 0x18
    MADD_31 = 0x19
    MSUB_31 = 0x1A
    MASK_33 = 0x1B
    HAD_33 = 0x1C
    OUTER_33 = 0x1D
    FUNC = 0x1E


class Kind(Enum):
    """What an operand is, which says what it may be written as and how large it may be."""

    MATRIX = "matrix"
    ELEMENT = "element"
    TARGET = "program address"
    COUNT = "count"
    EXPONENT = "exponent"
    FUNCTION = "function"


@dataclass(frozen=True, slots=True)
class Operand:
    """One operand: its name in messages, its kind, and its argument in the word, 0 to 2."""

    name: str
    kind: Kind
    argument: int


@dataclass(frozen=True, slots=True)
class Operation:
    """An instruction of the set; the operands stand in the order in which they are written."""

    opcode: Opcode
    operands: tuple[Operand, ...]

    @property
    def unused(self) -> tuple[int, ...]:
        """The arguments that must be zero."""
        used = {operand.argument for operand in self.operands}
        return tuple(argument for argument in range(ARGUMENTS) if argument not in used)


def _arithmetic(opcode: Opcode) -> Operation:
    sources = (Operand("first source", Kind.MATRIX, 0), Operand("second source", Kind.MATRIX, 1))
    return Operation(opcode, (*sources, _DESTINATION))


def _jump(opcode: Opcode) -> Operation:
    return Operation(opcode, (Operand("target", Kind.TARGET, 0),))


_DESTINATION = Operand("destination", Kind.MATRIX, 2)

PAPER: tuple[Operation, ...] = (
    Operation(Opcode.NOP, ()),
    _arithmetic(Opcode.ADD_33),
    _arithmetic(Opcode.MULT_31),
    _arithmetic(Opcode.MULT_33),
    Operation(Opcode.DET_33, (Operand("source", Kind.MATRIX, 0), _DESTINATION)),
    _arithmetic(Opcode.MULT_3S),
    Operation(Opcode.READ, (Operand("element", Kind.ELEMENT, 1), _DESTINATION)),
    Operation(Opcode.WRITE, (Operand("source", Kind.MATRIX, 0), Operand("element", Kind.ELEMENT, 1))),
    _jump(Opcode.JUMP_U),
    _jump(Opcode.JUMP_DRDY),
    _jump(Opcode.JUMP_ACK),
)
"""The eleven instructions of the paper (section 2.3)."""

_SOURCE = Operand("source", Kind.MATRIX, 0)
_ELEMENT = Operand("element", Kind.ELEMENT, 1)

EXTENSION: tuple[Operation, ...] = (
    Operation(Opcode.HALT, ()),
    Operation(Opcode.LOOP, (Operand("count", Kind.COUNT, 0),)),
    Operation(Opcode.NEXT, (Operand("target", Kind.TARGET, 0),)),
    Operation(Opcode.COPY, (_SOURCE, _DESTINATION)),
    Operation(Opcode.SCALE, (_SOURCE, Operand("exponent", Kind.EXPONENT, 1), _DESTINATION)),
    Operation(Opcode.RECIP, (_SOURCE, _ELEMENT, _DESTINATION)),
    Operation(Opcode.PICK, (_SOURCE, _ELEMENT, _DESTINATION)),
    _arithmetic(Opcode.SUB_33),
    _arithmetic(Opcode.MULT_33T),
    Operation(Opcode.TRANS_33, (_SOURCE, _DESTINATION)),
    Operation(Opcode.PLACE, (_SOURCE, _ELEMENT, _DESTINATION)),
    Operation(Opcode.ADJ_33, (_SOURCE, _DESTINATION)),
    _arithmetic(Opcode.SYMADD_33),
    _arithmetic(Opcode.SYMSUB_33),
    _arithmetic(Opcode.MADD_31),
    _arithmetic(Opcode.MSUB_31),
    _arithmetic(Opcode.MASK_33),
    _arithmetic(Opcode.HAD_33),
    _arithmetic(Opcode.OUTER_33),
    Operation(Opcode.FUNC, (_SOURCE, Operand("function", Kind.FUNCTION, 1), _DESTINATION)),
)
"""What a filter needs beyond them, on opcodes that the paper leaves free."""

FUNCTIONS = (
    Function.SINE,
    Function.COSINE,
    Function.SQUARE_ROOT,
    Function.EXPONENTIAL,
    Function.WRAP,
    Function.ARCTANGENT,
    Function.HYPOTENUSE,
)
"""The functions of FUNC by their numbers."""

ACCUMULATING = {Opcode.SYMADD_33, Opcode.SYMSUB_33, Opcode.MADD_31, Opcode.MSUB_31}
"""The instructions whose destination is a source too."""

VECTORS = {Opcode.MULT_31, Opcode.MADD_31, Opcode.MSUB_31}
"""The products of a matrix and a vector."""

SYMMETRIC = {Opcode.SYMADD_33, Opcode.SYMSUB_33}
"""The products whose lower triangle is the mirror of the upper one."""

MINORS = tuple(
    (
        (i + 1) % 3 * 3 + (j + 1) % 3,
        (i + 2) % 3 * 3 + (j + 2) % 3,
        (i + 1) % 3 * 3 + (j + 2) % 3,
        (i + 2) % 3 * 3 + (j + 1) % 3,
    )
    for i in range(3)
    for j in range(3)
)
"""The elements of every cofactor of a 3 by 3 matrix: first times second less third times fourth."""

OPERATIONS: dict[str, Operation] = {operation.opcode.name: operation for operation in (*PAPER, *EXTENSION)}
"""Every operation by its mnemonic."""

_BY_CODE = {operation.opcode.value: operation for operation in OPERATIONS.values()}
_ARGUMENT_MASK = (1 << ARGUMENT_BITS) - 1


@dataclass(frozen=True, slots=True)
class Instruction:
    """One instruction: its opcode and its three arguments, each below 512."""

    opcode: Opcode
    arguments: tuple[int, int, int] = (0, 0, 0)

    @property
    def operation(self) -> Operation:
        """Its entry in the instruction set."""
        return OPERATIONS[self.opcode.name]

    @property
    def operands(self) -> tuple[int, ...]:
        """The arguments that it has, in the order in which they are written."""
        return tuple(_read(self.arguments[each.argument], each.kind) for each in self.operation.operands)


def _read(argument: int, kind: Kind) -> int:
    """An exponent has a sign."""
    half = 1 << ARGUMENT_BITS - 1
    return (argument ^ half) - half if kind is Kind.EXPONENT else argument


def encode(instruction: Instruction) -> int:
    """The word of an instruction."""
    word = instruction.opcode.value
    for argument in instruction.arguments:
        assert 0 <= argument <= _ARGUMENT_MASK, instruction
        word = word << ARGUMENT_BITS | argument
    return word


def fields(word: int) -> tuple[int, tuple[int, int, int]]:
    """The opcode bits and the three arguments of any word."""
    shifts = (2 * ARGUMENT_BITS, ARGUMENT_BITS, 0)
    first, second, third = (word >> shift & _ARGUMENT_MASK for shift in shifts)
    return word >> ARGUMENTS * ARGUMENT_BITS, (first, second, third)


def decode(word: int) -> Instruction:
    """The instruction of a word.

    Raises ProgramError for an opcode that is none, and for an argument that must be zero and is not.
    """
    code, arguments = fields(word)
    operation = _BY_CODE.get(code)
    if operation is None:
        raise ProgramError(f"word 0x{word:08X}: there is no instruction with the opcode 0x{code:02X}")
    for argument in operation.unused:
        if arguments[argument]:
            raise ProgramError(
                f"word 0x{word:08X}: {operation.opcode.name} has no argument {argument + 1}, "
                f"yet it is {arguments[argument]}: it must be zero"
            )
    return Instruction(operation.opcode, arguments)


def build(mnemonic: Opcode, *operands: int) -> Instruction:
    """An instruction from its operands in the order in which they are written."""
    operation = OPERATIONS[mnemonic.name]
    arguments = [0] * ARGUMENTS
    for operand, value in zip(operation.operands, operands, strict=True):
        arguments[operand.argument] = value & _ARGUMENT_MASK if operand.kind is Kind.EXPONENT else value
    return Instruction(mnemonic, (arguments[0], arguments[1], arguments[2]))
