"""Constant multiplication as shifts and adds."""


def canonical_signed_digits(value: int) -> list[tuple[int, int]]:
    """The canonical signed digit form of an integer: (sign, exponent), from the least exponent up.

    No two digits that are not zero stand side by side, so there are as few as can be.
    """
    digits, exponent = [], 0
    while value:
        if value & 1:
            sign = 2 - (value & 3)
            digits.append((sign, exponent))
            value -= sign
        value >>= 1
        exponent += 1
    return digits
