"""What a core of the processor is built for: its parameters, and what they allow a program."""

from dataclasses import dataclass

from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.errors import ProgramError
from kalmanhdl.processor.instructions import ARGUMENT_BITS, Instruction, Kind, Opcode, decode

CLOCKS_PER_INSTRUCTION = 8
"""First fetch, second fetch, execute, write back: two clocks each (bhatia2012, figure 17)."""

_MOST_ADDRESSES = 1 << ARGUMENT_BITS
_NARROWEST, _WIDEST = 8, 32


@dataclass(frozen=True, slots=True, kw_only=True)
class Core:
    """One core: N by N matrices of one fixed-point format, and the sizes of its stores.

    Every element of a result is computed exactly and brought into the format once, with this rounding and
    overflow. ``matrices`` words in each of the N * N banks, ``program_words`` in the control store.

    Raises ProgramError for parameters outside what the words of an instruction can address.
    """

    form: Fixed
    rounding: Rounding = Rounding.HALF_EVEN
    overflow: Overflow = Overflow.SATURATE
    matrices: int = 512
    program_words: int = 512

    def __post_init__(self) -> None:
        if not (self.form.signed and _NARROWEST <= self.form.width <= _WIDEST):
            raise ProgramError(
                f"core: {self.form}: the words of a core are signed and have {_NARROWEST} to {_WIDEST} bits"
            )
        if not 0 <= self.form.fraction <= self.form.width:
            raise ProgramError(f"core: {self.form}: its point stands inside the word, 0 to {self.form.width}")
        for name in ("matrices", "program_words"):
            size = getattr(self, name)
            if not 2 <= size <= _MOST_ADDRESSES or size & (size - 1):
                raise ProgramError(
                    f"core: {name} = {size}: a store has a power of two of words, 2 to {_MOST_ADDRESSES}"
                )

    @property
    def size(self) -> int:
        """N: matrices are N by N."""
        return 3

    @property
    def elements(self) -> int:
        """Elements of a matrix, each in a bank of its own; row after row."""
        return self.size * self.size

    @property
    def address_bits(self) -> int:
        """Bits of a matrix's address that count."""
        return (self.matrices - 1).bit_length()

    @property
    def program_bits(self) -> int:
        """Bits of a program address that count."""
        return (self.program_words - 1).bit_length()

    def limit(self, kind: Kind) -> int:
        """The number below which an operand of a kind must lie."""
        match kind:
            case Kind.MATRIX:
                return self.matrices
            case Kind.ELEMENT:
                return self.elements
            case Kind.TARGET:
                return self.program_words


PAPER_CORE = Core(form=Fixed(width=8, fraction=4), rounding=Rounding.FLOOR, overflow=Overflow.WRAP)
"""The core of the paper: 8 bits. It does not say where the point stands, nor how it rounds."""


def checked(words: tuple[int, ...], core: Core) -> tuple[Instruction, ...]:
    """The instructions of an image, all of which the core can run.

    Raises ProgramError, naming the address, for an image that does not fit, a word that is no instruction,
    or an operand outside the core's stores.
    """
    if len(words) > core.program_words:
        raise ProgramError(
            f"the program has {len(words)} words and the control store {core.program_words}: shorten it"
        )
    return tuple(_checked(address, word, core) for address, word in enumerate(words))


def _checked(address: int, word: int, core: Core) -> Instruction:
    try:
        instruction = decode(word)
    except ProgramError as error:
        raise ProgramError(f"address {address}: {error}") from None
    for operand, value in zip(instruction.operation.operands, instruction.operands, strict=True):
        limit = core.limit(operand.kind)
        if value >= limit:
            raise ProgramError(
                f"address {address}: {instruction.opcode.name}: {operand.name} is {value}: "
                f"{_rule(operand.kind, limit)}"
            )
    return instruction


def _rule(kind: Kind, limit: int) -> str:
    match kind:
        case Kind.MATRIX:
            return f"the data store has {limit} matrices, 0 to {limit - 1}"
        case Kind.ELEMENT:
            return f"a matrix has the elements 0 to {limit - 1}"
        case Kind.TARGET:
            return f"the control store has the addresses 0 to {limit - 1}"


def writes(opcode: Opcode, core: Core) -> range:
    """The elements of the destination that an arithmetic instruction writes; the others stay."""
    match opcode:
        case Opcode.MULT_31:
            return range(core.size)
        case Opcode.DET_33:
            return range(1)
        case Opcode.ADD_33 | Opcode.MULT_33 | Opcode.MULT_3S:
            return range(core.elements)
        case _:
            return range(0)
