"""What a core of the processor is built for: its parameters, and what they allow a program."""

from collections.abc import Sequence
from dataclasses import dataclass

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.fixed import Fixed, Overflow, Rounding
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.errors import ProgramError
from kalmanhdl.graph.operations import Function
from kalmanhdl.processor.instructions import (
    ARGUMENT_BITS,
    EXTENSION,
    FUNCTIONS,
    VECTORS,
    Instruction,
    Kind,
    Opcode,
    decode,
)
from kalmanhdl.processor.numbers import Numbers, check_words, numbers_of

CLOCKS_PER_INSTRUCTION = 8
"""First fetch, second fetch, execute, write back: two clocks each (bhatia2012, figure 17)."""

_MOST_ADDRESSES = 1 << ARGUMENT_BITS
_LARGEST = 16
_INDEX_BITS = 7

LOOPS = 4
"""Loops that may stand in each other."""

_ADDED = {operation.opcode for operation in EXTENSION}
_OF_THREE = {Opcode.DET_33, Opcode.ADJ_33}


@dataclass(frozen=True, slots=True, kw_only=True)
class Core:
    """One core: N by N matrices of one format, and the sizes of its stores.

    In fixed point every element of a result is computed exactly and brought into the format once, with this
    rounding and overflow. In floating point every operation rounds, as the format says. ``matrices`` words in
    each of the N * N banks, ``program_words`` in the control store. An ``extended`` core has more
    instructions than the paper's eleven, and these ``functions`` of FUNC, in their order. ``units`` is how
    many sums of N products it computes in a clock, on N multipliers each: with any its instructions overlap
    (``timing.py``), with none each takes the paper's eight clocks, or as often eight as it needs.

    Raises ProgramError for parameters outside what the words of an instruction can address.
    """

    form: Fixed | Float
    rounding: Rounding = Rounding.HALF_EVEN
    overflow: Overflow = Overflow.SATURATE
    matrices: int = 512
    program_words: int = 512
    size: int = 3
    extended: bool = False
    units: int = 0
    functions: tuple[Function, ...] = ()

    def __post_init__(self) -> None:
        if not 2 <= self.size <= _LARGEST:
            raise ProgramError(f"core: size = {self.size}: matrices are 2 by 2 to {_LARGEST} by {_LARGEST}")
        check_words(self.form)
        if not 0 <= self.units <= self.elements:
            raise ProgramError(
                f"core: units = {self.units}: a pipelined core computes 1 to {self.elements} elements "
                f"a clock, on {self.size} multipliers each; 0 for eight clocks an instruction"
            )
        if self.functions != tuple(each for each in FUNCTIONS if each in self.functions):
            raise ProgramError("core: functions: each one once, in the order of their numbers")
        if self.functions and not self.extended:
            raise ProgramError("core: functions: they are for an extended core")
        for name in ("matrices", "program_words"):
            size = getattr(self, name)
            if not 2 <= size <= _MOST_ADDRESSES or size & (size - 1):
                raise ProgramError(
                    f"core: {name} = {size}: a store has a power of two of words, 2 to {_MOST_ADDRESSES}"
                )

    @property
    def pipelined(self) -> bool:
        """Whether its instructions overlap."""
        return self.units > 0

    @property
    def floating(self) -> bool:
        """Whether its numbers are floating point."""
        return isinstance(self.form, Float)

    @property
    def fixed_form(self) -> Fixed:
        """The format of a core of fixed-point numbers."""
        assert isinstance(self.form, Fixed)
        return self.form

    @property
    def float_form(self) -> Float:
        """The format of a core of floating-point numbers."""
        assert isinstance(self.form, Float)
        return self.form

    @property
    def numbers(self) -> Numbers:
        """What its words are."""
        return numbers_of(self.form)

    @property
    def sums(self) -> int:
        """Sums of N products that it begins in a clock; N of floats where instructions do not overlap."""
        return self.units or (self.size if self.floating else self.elements)

    @property
    def multipliers(self) -> int:
        """Multipliers for the products of matrices."""
        return self.size * self.sums

    @property
    def division(self) -> TableNewton:
        """How RECIP finds its result: exact to the last bits of a word."""
        iterations = 0
        while (_INDEX_BITS + 2) << iterations < self.fixed_form.width + 2:
            iterations += 1
        return TableNewton(index_bits=_INDEX_BITS, iterations=iterations)

    @property
    def exponents(self) -> range:
        """What SCALE can shift by: two to this power is a number of the format."""
        return self.numbers.exponents

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

    def has(self, opcode: Opcode) -> bool:
        """Whether it has an instruction."""
        if opcode is Opcode.FUNC:
            return bool(self.functions)
        return (self.extended or opcode not in _ADDED) and (self.size == 3 or opcode not in _OF_THREE)

    def allowed(self, kind: Kind) -> Sequence[int]:
        """What an operand of a kind may be."""
        match kind:
            case Kind.MATRIX:
                return range(self.matrices)
            case Kind.ELEMENT:
                return range(self.elements)
            case Kind.TARGET:
                return range(self.program_words)
            case Kind.COUNT:
                return range(1, _MOST_ADDRESSES)
            case Kind.EXPONENT:
                return self.exponents
            case Kind.FUNCTION:
                return tuple(FUNCTIONS.index(each) for each in self.functions)


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
    instructions = tuple(_checked(address, word, core) for address, word in enumerate(words))
    _check_loops(instructions)
    return instructions


def _checked(address: int, word: int, core: Core) -> Instruction:
    try:
        instruction = decode(word)
    except ProgramError as error:
        raise ProgramError(f"address {address}: {error}") from None
    name = instruction.opcode.name
    if not core.has(instruction.opcode):
        raise ProgramError(f"address {address}: {name}: {missing(instruction.opcode, core)}")
    for operand, value in zip(instruction.operation.operands, instruction.operands, strict=True):
        allowed = core.allowed(operand.kind)
        if value not in allowed:
            raise ProgramError(
                f"address {address}: {name}: {operand.name} is {value}: {_rule(operand.kind, core)}"
            )
    return instruction


def missing(opcode: Opcode, core: Core) -> str:
    """Why a core lacks an instruction."""
    if core.extended and opcode is Opcode.FUNC:
        return "the core is built without functions"
    if core.extended:
        return f"it is for matrices of 3 by 3, and the core's are {core.size} by {core.size}"
    return "the core has the paper's instructions alone: take an extended one"


def _rule(kind: Kind, core: Core) -> str:
    allowed = core.allowed(kind)
    first, last = allowed[0], allowed[-1]
    match kind:
        case Kind.MATRIX:
            return f"the data store has {len(allowed)} matrices, 0 to {last}"
        case Kind.ELEMENT:
            return f"a matrix has the elements 0 to {last}"
        case Kind.TARGET:
            return f"the control store has the addresses 0 to {last}"
        case Kind.COUNT:
            return f"a loop is passed {first} to {last} times"
        case Kind.EXPONENT:
            return f"two to its power is a number of the core's format from {first} to {last}"
        case Kind.FUNCTION:
            return f"the core has {functions_of(core)}"


def functions_of(core: Core) -> str:
    """The functions of a core in words, with their numbers."""
    return ", ".join(f"{each.value} ({FUNCTIONS.index(each)})" for each in core.functions)


def _check_loops(instructions: tuple[Instruction, ...]) -> None:
    """Every NEXT ends its LOOP, no more are open than the stack holds, and no jump leaves or enters one."""
    starts: list[int] = []
    inside: list[tuple[int, ...]] = []
    for address, instruction in enumerate(instructions):
        place = f"address {address}: {instruction.opcode.name}"
        if instruction.opcode is Opcode.NEXT:
            if not starts:
                raise ProgramError(f"{place}: there is no LOOP that it could end")
            if instruction.arguments[0] != starts[-1]:
                raise ProgramError(
                    f"{place}: goes to {instruction.arguments[0]}, and its loop begins at {starts[-1]}"
                )
        inside.append(tuple(starts))
        if instruction.opcode is Opcode.NEXT:
            starts.pop()
        elif instruction.opcode is Opcode.LOOP:
            starts.append(address + 1)
            if len(starts) > LOOPS:
                raise ProgramError(f"{place}: the stack of loops holds {LOOPS}: put fewer into each other")
    if starts:
        raise ProgramError(f"address {starts[-1] - 1}: LOOP: no NEXT ends it")
    for address, instruction in enumerate(instructions):
        if instruction.opcode in (Opcode.JUMP_U, Opcode.JUMP_DRDY, Opcode.JUMP_ACK):
            target = instruction.arguments[0]
            outside = target < len(inside) and inside[target] != inside[address]
            if outside or (inside[address] and target >= len(inside)):
                raise ProgramError(
                    f"address {address}: {instruction.opcode.name}: {target} lies across a loop's border"
                )


def writes(instruction: Instruction, core: Core) -> range:
    """The elements of the destination that an instruction writes; the others stay."""
    match instruction.opcode:
        case opcode if opcode in VECTORS:
            return range(core.size)
        case Opcode.DET_33 | Opcode.PICK | Opcode.FUNC:
            return range(1)
        case Opcode.READ | Opcode.PLACE | Opcode.RECIP:
            return range(instruction.arguments[1], instruction.arguments[1] + 1)
        case (
            Opcode.ADD_33
            | Opcode.SUB_33
            | Opcode.MULT_33
            | Opcode.MULT_33T
            | Opcode.MULT_3S
            | Opcode.TRANS_33
            | Opcode.COPY
            | Opcode.SCALE
            | Opcode.ADJ_33
            | Opcode.SYMADD_33
            | Opcode.SYMSUB_33
            | Opcode.MASK_33
            | Opcode.HAD_33
            | Opcode.OUTER_33
        ):
            return range(core.elements)
        case _:
            return range(0)
