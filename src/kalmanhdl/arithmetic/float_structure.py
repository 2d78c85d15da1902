"""The pieces of logic that floating-point operators are made of, in order.

Cores and schedulers both ask here. No register stands inside a piece; the weights of the pieces, which
know no device, tell where registers stand between them.
"""

from dataclasses import dataclass

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.arithmetic.floating import Float
from kalmanhdl.arithmetic.product_structure import block_addends, logic_addends, tree_levels

Part = tuple[str, int]
"""A kind of logic, as the devices' tables of delays name it, and its size."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Logic between two places for a register: paths side by side, each of parts one after the other."""

    paths: tuple[tuple[Part, ...], ...]

    @property
    def weight(self) -> float:
        """The delay in levels of adders."""
        return max(sum(_level(*part) for part in path) for path in self.paths)


def _level(kind: str, size: int) -> float:
    places = max(size - 1, 1).bit_length()
    match kind:
        case "select":
            return 0.5
        case "compare":
            return 1.1
        case "multiply":
            return 1.6
        case "leading_one":
            return 0.3 * places
        case _:
            return 1.0


def weights(pieces: tuple[Piece, ...]) -> tuple[float, ...]:
    """The weights of a chain of pieces."""
    return tuple(piece.weight for piece in pieces)


def one(*parts: Part) -> Piece:
    """A piece of one path."""
    return Piece((parts,))


def beside(*pieces: Piece) -> Piece:
    """Whole pieces side by side."""
    return Piece(tuple(path for piece in pieces for path in piece.paths))


def exponent_width(form: Float, slack: int = 0) -> int:
    """Bits of an exponent on its way to a result: signed, twice as far as the format's own.

    ``slack`` is the greatest number that is taken from it beside.
    """
    return max(form.exponent, slack.bit_length()) + 2


def levels(most: int) -> int:
    """Levels of a shift by 0 to ``most`` places."""
    return most.bit_length()


def right_shift(most: int) -> tuple[Piece, ...]:
    """A shift by 0 to ``most`` places that keeps whether a one fell out, a level a piece."""
    return (one(("select", most)),) * levels(most)


def normalisation(width: int) -> tuple[Piece, ...]:
    """A shift that brings the leading one of so many bits to the top, a level a piece."""
    tests = (1 << level for level in reversed(range(1, levels(width - 1))))
    return (*(one(("leading_one", bits), ("select", width)) for bits in tests), one(("select", width)))


def rounding(form: Float, width: int) -> tuple[Piece, ...]:
    """Rounding of a significand with an exponent of so many bits, what leaves the format, encoding."""
    add = one(("add", form.mantissa + width))
    return (add, one(("compare", width)), one(("select", form.width)))


def denormalisation(form: Float, width: int) -> tuple[Piece, ...]:
    """How far below the least normal number a result lies, and its shift by as much."""
    if not form.subnormals:
        return ()
    return (one(("add", width), ("select", width)), *right_shift(form.mantissa + 2))


def sum_width(form: Float) -> int:
    """Bits of the sum of two significands with a guard, a round and a sticky bit, and its carry."""
    return form.mantissa + 5


def addition(form: Float) -> tuple[Piece, ...]:
    """Order, alignment, sum, normalisation, rounding."""
    width = sum_width(form)
    return (
        Piece(((("add", form.width - 1),), (("select", 1), ("add", form.exponent)))),
        one(("select", form.mantissa)),
        *right_shift(form.mantissa + 3),
        one(("add", width)),
        *normalisation(width),
        one(("add", exponent_width(form, width))),
        *rounding(form, exponent_width(form, width)),
    )


def product(width: int, on_block: bool) -> tuple[Piece, ...]:
    """The product of two unsigned numbers of so many bits."""
    addends = (block_addends if on_block else logic_addends)(width, False, width, False)
    first = one(("multiply", 18)) if on_block else one(("select", width))
    return (first, *(one(("add", 2 * width)),) * tree_levels(addends))


def multiplication(form: Float, on_block: bool) -> tuple[Piece, ...]:
    """Product beside the count of how far it is to be moved, the move, rounding."""
    significand, exponent = form.mantissa + 1, exponent_width(form, form.mantissa)
    first, *tree = product(significand, on_block)
    place = one(("add", exponent), ("select", exponent))
    if not form.subnormals:
        start = (beside(first, one(("add", form.exponent), ("add", exponent))), *tree)
        return (*start, one(("select", significand)), *rounding(form, exponent))
    count = beside(one(("leading_one", significand)), one(("add", form.exponent), ("add", exponent)))
    move = right_shift(2 * form.mantissa + 3)
    tree = [*tree[:-1], beside(*tree[-1:], place)]
    return (beside(first, count), *tree, *move, one(("select", significand)), *rounding(form, exponent))


def division(form: Float) -> tuple[Piece, ...]:
    """Normalised operands, a row for each bit of the quotient, its remainder, its place, rounding."""
    width = exponent_width(form, form.mantissa)
    row = one(("add", form.mantissa + 2))
    first = beside(row, one(("add", width), ("add", width)))
    normal = normalisation(form.mantissa + 1) if form.subnormals else ()
    return (
        *normal,
        first,
        *(row,) * (form.mantissa + 2),
        one(("add", form.mantissa + 2), ("select", 8)),
        one(("select", form.mantissa + 2)),
        *denormalisation(form, width),
        *rounding(form, width),
    )


def root_underflows(form: Float) -> bool:
    """Whether a square root can be subnormal: where the mantissa reaches further down than the exponent."""
    return form.subnormals and form.mantissa >= form.bias


def rooting(form: Float) -> tuple[Piece, ...]:
    """A normalised operand, a row for each bit of the root but the first, the remainder, rounding."""
    width = exponent_width(form, form.mantissa)
    return (
        *(normalisation(form.mantissa + 1) if form.subnormals else ()),
        one(("add", width), ("add", width), ("select", form.mantissa)),
        *(one(("add", digits + 3)) for digits in range(1, form.mantissa + 2)),
        one(("add", form.mantissa + 4), ("select", 8)),
        *(denormalisation(form, width) if root_underflows(form) else ()),
        *rounding(form, width),
    )


def scaling(form: Float, exponent: int) -> tuple[Piece, ...]:
    """A shift of what is subnormal before or after, a sum of exponents, rounding."""
    width = exponent_width(form, abs(exponent) + form.mantissa)
    before = normalisation(form.mantissa + 1) if form.subnormals and exponent > 0 else ()
    after = denormalisation(form, width) if exponent < 0 else ()
    return (*before, one(("add", width), ("add", width)), *after, *rounding(form, width))


def wrapping(form: Float) -> tuple[Piece, ...]:
    """The bits above the binary point shifted out, what is left taken from one, its place, rounding."""
    significand, width = form.mantissa + 1, exponent_width(form, form.mantissa + 1)
    return (
        one(("add", form.exponent), ("compare", form.exponent)),
        *(one(("select", significand)),) * levels(significand),
        one(("add", significand), ("select", significand)),
        *normalisation(significand),
        one(("add", width)),
        *rounding(form, width),
    )


def comparison(form: Float) -> tuple[Piece, ...]:
    """The magnitudes compared, then the signs."""
    return (one(("add", form.width - 1)), one(("select", 1)))


def converted_width(form: Float, fixed: Fixed) -> int:
    """Bits of a number in a fixed-point format, one above for its least number, two below for rounding."""
    return max(fixed.width - fixed.signed + 3, form.mantissa + 2)


def conversion_to_fixed(form: Float, fixed: Fixed) -> tuple[Piece, ...]:
    """The shift to the place of the format, rounding, limits and sign."""
    width = converted_width(form, fixed)
    return (
        one(("add", form.exponent + 2)),
        *(one(("select", width)),) * levels(width),
        one(("add", fixed.width)),
        one(("compare", fixed.width), ("select", fixed.width), ("add", fixed.width)),
    )


def converted_exponent_width(form: Float, fixed: Fixed) -> int:
    """Bits of the exponent of a number that comes from a fixed-point format, signed."""
    reach = fixed.width + max(fixed.width, form.mantissa + 3) + abs(fixed.fraction) + form.bias
    return max(form.exponent, reach.bit_length()) + 2


def conversion_from_fixed(form: Float, fixed: Fixed) -> tuple[Piece, ...]:
    """Magnitude, normalisation, its place, rounding."""
    width = converted_exponent_width(form, fixed)
    return (
        one(("add", fixed.width)),
        *normalisation(max(fixed.width, form.mantissa + 3)),
        one(("add", width)),
        *denormalisation(form, width),
        *rounding(form, width),
    )


def fused_width(form: Float) -> int:
    """Bits of the exact sum of a product and a number, with a sticky bit.

    The number may stand two places above the product, and two places below it bits still decide a rounding:
    the product of a subnormal has its leading one as low as the last bit of the significand.
    """
    return 3 * form.mantissa + 8


def fused_addition(form: Float, on_block: bool) -> tuple[Piece, ...]:
    """Product, alignment of the addend with it, sum, its magnitude, normalisation, rounding."""
    width = fused_width(form)
    exponent = exponent_width(form, width) + 1
    first, *tree = product(form.mantissa + 1, on_block)
    place = one(("select", exponent), ("add", exponent), ("select", exponent))
    return (
        beside(first, one(("add", form.exponent), ("add", exponent))),
        *tree[:-1],
        beside(*tree[-1:], place),
        *right_shift(width - 1),
        *(one(("add", width)),) * 2,
        *normalisation(width),
        one(("add", exponent)),
        *rounding(form, exponent),
    )


def row_number(form: Float, rows: int) -> tuple[Piece, ...]:
    """The whole part of a number as the number of one of so many rows, and the row."""
    places = levels(rows - 1)
    return (
        one(("add", form.exponent), ("compare", form.exponent)),
        *right_shift(places),
        one(("compare", places), ("table", places)),
    )
