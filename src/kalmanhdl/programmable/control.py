"""The control store as data: the fields of a row, and where every word of an image is written."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from kalmanhdl.programmable.operations import Kind, Operation
from kalmanhdl.shape import Shape

# The clocks of a row, counted from the one in which operands are read from a file: the operands stand in
# registers, the exact result, the shifted one, the rounded one, and the one in the format, which is written.
OPERANDS, EXACT, SHIFTED, ROUNDED, WRITTEN = 2, 3, 4, 5, 6
# An input is chosen, and written a clock later.
INPUT_WRITTEN = 1
# Clocks from a divisor to its reciprocal by a table.
LOOKED_UP = 3
# Bits that a stage can drop; each shift is this less the bits that are dropped.
MOST_DROPPED = 31
SHIFT_BITS = 6
MOST_ADDED = (1 << SHIFT_BITS) - 1 - MOST_DROPPED
ROUNDING_BITS = 2
WATCH_STARTING, WATCH_RUNNING = 1, 2
# Of the quotient each clock gives so many bits.
QUOTIENT_BITS_PER_CLOCK = 2
# An exact quotient is twice the integer quotient and a bit that says whether something remains.
DROPPED_OF_QUOTIENT = 2

HEADER = 0
"""The section of an image whose one word is the last row that is run; to write it clears the states' bank."""


def quotient_bits(shape: Shape) -> int:
    """Bits of the integer quotient that the divider gives: an even number."""
    return (shape.word_width - 3) // QUOTIENT_BITS_PER_CLOCK * QUOTIENT_BITS_PER_CLOCK


def quotient_clocks(exponent: int) -> int:
    """Clocks in which the bits of 2**exponent / divisor come, each some of them."""
    return exponent // QUOTIENT_BITS_PER_CLOCK + 1


def busy_clocks(operation: Operation) -> int:
    """Clocks in which a unit takes no other operation."""
    return 1 if operation.exponent is None else quotient_clocks(operation.exponent) + 1


def written_after(operation: Operation) -> int:
    """Clocks from the row that starts an operation to the row that writes its result."""
    match operation.kind:
        case Kind.INPUT:
            return INPUT_WRITTEN
        case Kind.RECIPROCAL:
            return OPERANDS + (LOOKED_UP if operation.exponent is None else busy_clocks(operation))
        case Kind.MULTIPLY | Kind.ADD:
            return WRITTEN


@dataclass(frozen=True)
class Layout:
    """The rows of a shape's control store.

    An address of a file has a bit above it: a word of the two banks of a state, the lowest bit of whose
    address is inverted in every other step.
    """

    shape: Shape

    @property
    def address_bits(self) -> int:
        """Bits of an address in a file, the bit for banks included."""
        return (self.shape.words - 1).bit_length() + 1

    @cached_property
    def fields(self) -> Mapping[str, int]:
        """Bits of each field of a row, from the lowest on."""
        shape = self.shape
        sources = (len(shape.unit_names) - 1).bit_length()
        found: dict[str, int] = {}
        for file in shape.files:
            found[f"{file}_read"] = self.address_bits
            found[f"{file}_enable"] = 1
            found[f"{file}_source"] = sources
            found[f"{file}_write"] = self.address_bits
        for unit in shape.rounding_units:
            found |= {
                f"{unit}_shift": SHIFT_BITS,
                f"{unit}_rounding": ROUNDING_BITS,
                f"{unit}_width": shape.word_width.bit_length(),
                f"{unit}_unsigned": 1,
                f"{unit}_wrap": 1,
                f"{unit}_watch": 2,
            }
            if unit.startswith("add"):
                found[f"{unit}_function"] = 2
        if shape.reciprocal_table is None:
            found |= {
                "reciprocal_begin": 1,
                "reciprocal_clocks": quotient_clocks(quotient_bits(shape) - 1).bit_length(),
                "reciprocal_place": (QUOTIENT_BITS_PER_CLOCK - 1).bit_length(),
            }
        found["input_choice"] = (len(shape.inputs) - 1).bit_length()
        found |= {"output_enable": 1, "output_source": sources}
        found["output_write"] = (len(shape.outputs) - 1).bit_length()
        return found

    @cached_property
    def places(self) -> Mapping[str, int]:
        """The lowest bit of each field."""
        place, found = 0, {}
        for name, bits in self.fields.items():
            found[name] = place
            place += bits
        return found

    @property
    def row_bits(self) -> int:
        """Bits of a row."""
        return sum(self.fields.values())

    @property
    def chunk_widths(self) -> tuple[int, ...]:
        """Bits of each chunk in which a row is written, from the lowest on: words, the last one shorter."""
        whole, rest = divmod(self.row_bits, self.shape.word_width)
        return (self.shape.word_width,) * whole + ((rest,) if rest else ())

    @property
    def index_bits(self) -> int:
        """Bits of the lower part of an address of an image: a row, or a word of a file."""
        return (max(self.shape.rows, self.shape.words) - 1).bit_length()

    @property
    def sections(self) -> int:
        """The header, the chunks of rows, the files, in this order: the upper part of an address."""
        return 1 + len(self.chunk_widths) + len(self.shape.files)

    @property
    def image_address_bits(self) -> int:
        """Bits of an address of an image."""
        return (self.sections - 1).bit_length() + self.index_bits

    def chunk_section(self, chunk: int) -> int:
        """The section of a chunk of the rows."""
        return HEADER + 1 + chunk

    def file_section(self, file: str) -> int:
        """The section of a file."""
        return HEADER + 1 + len(self.chunk_widths) + self.shape.files.index(file)

    def packed(self, row: Mapping[str, int]) -> int:
        """A row as one integer; fields that are not given are 0."""
        word = 0
        for name, value in row.items():
            assert 0 <= value < 1 << self.fields[name], (name, value)
            word |= value << self.places[name]
        return word

    def chunks(self, row: int) -> list[int]:
        """A packed row cut into its chunks."""
        found = []
        for width in self.chunk_widths:
            found.append(row & ((1 << width) - 1))
            row >>= width
        return found
