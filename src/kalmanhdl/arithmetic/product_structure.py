"""How large the hardware of a multiplication is, from the widths of its operands."""


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


def tree_levels(terms: int) -> int:
    """Levels of adders that bring so many addends down to one."""
    return max(terms - 1, 0).bit_length()
