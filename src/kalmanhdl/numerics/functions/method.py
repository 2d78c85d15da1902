"""How functions beyond arithmetic are computed: what a design may choose."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Cordic:
    """Shifts and adds alone, a bit of the result for each iteration (Volder 1959; Walther 1971)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interpolation:
    """Polynomials between the rows of tables with 2**index_bits rows, of the degree that the result needs."""

    index_bits: int


FunctionMethod = Cordic | Interpolation

# A wider result would take polynomials of degree four and multiplications of many blocks.
_WIDEST_INTERPOLATION = 32
_MOST_INDEX_BITS = 8


def method_for(width: int) -> FunctionMethod:
    """The method for results of a width where the design asks for none."""
    if width > _WIDEST_INTERPOLATION:
        return Cordic()
    return Interpolation(index_bits=min(_MOST_INDEX_BITS, -(-width // 2)))
