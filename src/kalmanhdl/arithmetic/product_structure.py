"""How large the hardware of a multiplication is, from the widths of its operands."""

from collections.abc import Sequence
from enum import Enum
from itertools import accumulate


class LogicProduct(Enum):
    """How a multiplication is built where it has no multiplier block."""

    BOOTH = "booth"
    WALLACE = "wallace"


def limb_widths(width: int, signed: bool, other_signed: bool, block_width: int = 18) -> tuple[int, ...]:
    """The bits of each limb, lowest first, of an operand cut for multiplier blocks of ``block_width``.

    A block multiplies two signed or two unsigned numbers. Every limb but the top one is unsigned, and
    an unsigned limb that can meet a signed one has a bit less.
    """
    low = block_width - (signed or other_signed)
    top = block_width if signed or not other_signed else low
    below = max(-(-(width - top) // low), 0)
    return (*(low,) * below, width - below * low)


def booth_rows(width: int, signed: bool) -> int:
    """Partial products of a multiplication from logic when this operand is recoded in radix 4."""
    return (width + 1) // 2 if signed else width // 2 + 1


def booth_terms(width: int, signed: bool) -> int:
    """The addends of a multiplication from logic: its rows, and the last row's sign if it can have one."""
    return booth_rows(width, signed) + signed


def recodes_first(a_width: int, a_signed: bool, b_width: int, b_signed: bool) -> bool:
    """Whether the first of two operands is recoded: the one that makes fewer addends."""
    return booth_terms(a_width, a_signed) < booth_terms(b_width, b_signed)


def serial_rows(a_width: int, a_signed: bool, b_width: int, b_signed: bool) -> int:
    """Booth rows that are added one after the other where there is an adder for one."""
    swapped = recodes_first(a_width, a_signed, b_width, b_signed)
    return booth_rows(a_width, a_signed) if swapped else booth_rows(b_width, b_signed)


def logic_addends(a_width: int, a_signed: bool, b_width: int, b_signed: bool) -> int:
    """The addends of a multiplication from logic."""
    return min(booth_terms(a_width, a_signed), booth_terms(b_width, b_signed))


def baugh_wooley(a_width: int, a_signed: bool, b_width: int, b_signed: bool) -> int:
    """What is added to the partial products of bits once those of negative weight are complemented.

    A bit of negative weight, one sign bit times a bit that is none, is worth -w x = w (1 - x) - w (Baugh &
    Wooley 1973). Modulo 2**(a_width + b_width).
    """
    weights = (
        1 << (i + j)
        for i in range(a_width)
        for j in range(b_width)
        if (a_signed and i == a_width - 1) != (b_signed and j == b_width - 1)
    )
    return -sum(weights) % (1 << (a_width + b_width))


def wallace_rows(a_width: int, a_signed: bool, b_width: int, b_signed: bool) -> int:
    """The addends of a multiplication from single bits: one a bit of the shorter operand, and a constant."""
    return min(a_width, b_width) + (baugh_wooley(a_width, a_signed, b_width, b_signed) != 0)


def wallace_levels(rows: int) -> int:
    """Levels of carry-save adders, three rows to two, that bring so many rows down to two at most."""
    levels = 0
    while rows > 2:
        rows -= rows // 3
        levels += 1
    return levels


def block_addends(a_width: int, a_signed: bool, b_width: int, b_signed: bool) -> int:
    """The addends of a multiplication on blocks: the products of limbs, some joined end to end."""
    a = _places(limb_widths(a_width, a_signed, b_signed))
    b = _places(limb_widths(b_width, b_signed, a_signed))
    top_a, top_b = a[-1], b[-1]
    return len(
        joined(
            [
                (x[0] + y[0], x[1] + y[1], (a_signed and x == top_a) or (b_signed and y == top_b))
                for x in a
                for y in b
            ]
        )
    )


def joined(spans: Sequence[tuple[int, int, bool]]) -> list[list[int]]:
    """Groups of addends, each of them (first position, position above the last, signed).

    An addend that begins above the end of an unsigned one can be set in front of it, and needs no adder.
    Groups are lists of indices, the lowest first, ordered by their first position.
    """
    left = sorted(range(len(spans)), key=lambda index: spans[index][0])
    groups: list[list[int]] = []
    while left:
        group = [left.pop(0)]
        while not spans[group[-1]][2]:
            above = next((index for index in left if spans[index][0] >= spans[group[-1]][1]), None)
            if above is None:
                break
            left.remove(above)
            group.append(above)
        groups.append(group)
    return groups


def _places(widths: tuple[int, ...]) -> list[tuple[int, int]]:
    """First position and position above the last of each limb."""
    ends = list(accumulate(widths))
    return [(end - width, end) for end, width in zip(ends, widths, strict=True)]


def tree_levels(terms: int) -> int:
    """Levels of adders that bring so many addends down to one."""
    return max(terms - 1, 0).bit_length()


def product_pieces(
    a_width: int, a_signed: bool, b_width: int, b_signed: bool, logic: LogicProduct | None
) -> int:
    """The pieces of a product between which registers can stand; ``logic`` None: on multiplier blocks."""
    widths = (a_width, a_signed, b_width, b_signed)
    if logic is LogicProduct.WALLACE:
        return 2 + wallace_levels(wallace_rows(*widths))
    if logic is LogicProduct.BOOTH:
        return 1 + tree_levels(logic_addends(*widths))
    limbs = len(limb_widths(a_width, a_signed, b_signed)) * len(limb_widths(b_width, b_signed, a_signed))
    return 1 + tree_levels(limbs)
