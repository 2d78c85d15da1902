"""Products of single bits, summed by levels of carry-save adders (Wallace 1964; Baugh & Wooley 1973)."""

from collections.abc import Sequence

from amaranth.hdl import Cat, Const, Module, Value

from kalmanhdl.arithmetic.product_structure import baugh_wooley, wallace_levels
from kalmanhdl.rtl.adder_tree import Term
from kalmanhdl.rtl.shapes import fitted
from kalmanhdl.rtl.stages import Stages, named


def bit_products(m: Module, name: str, a: Value, b: Value) -> list[Term]:
    """The product of two numbers as unsigned addends: a row for each bit of the shorter one.

    Bits of negative weight are complemented; what makes up for it is the last row. All modulo 2**(the sum of
    both widths).
    """
    if len(a) < len(b):
        a, b = b, a
    constant = baugh_wooley(len(a), a.shape().signed, len(b), b.shape().signed)
    rows = [Term(j, named(m, f"{name}_row_{j}", _row(a, b, j))) for j in range(len(b))]
    if constant:
        # The zeros below its last one need no bits.
        offset = (constant & -constant).bit_length() - 1
        rows.append(Term(offset, Const(constant >> offset)))
    return rows


def _row(a: Value, b: Value, j: int) -> Value:
    """The bits of a times bit j of b, those of negative weight complemented."""
    top_of_b = b.shape().signed and j == len(b) - 1
    bits = a.as_unsigned() & b[j].replicate(len(a))
    complemented = sum(1 << i for i in range(len(a)) if (a.shape().signed and i == len(a) - 1) != top_of_b)
    return bits ^ Const(complemented, len(a))


def carry_saved(m: Module, stages: Stages, first_step: int, rows: Sequence[Term], width: int) -> list[Term]:
    """Two addends at most with the same sum modulo 2**width, as many steps as ``wallace_levels`` says."""
    for step in range(first_step, first_step + wallace_levels(len(rows))):
        values = stages.before(step, {f"row_{k}": row.value for k, row in enumerate(rows)})
        here = [Term(row.offset, value) for row, value in zip(rows, values.values(), strict=True)]
        here.sort(key=lambda row: row.offset)
        whole = len(here) - len(here) % 3
        triples = [here[k : k + 3] for k in range(0, whole, 3)]
        rows = here[whole:]
        for k, triple in enumerate(triples):
            rows = [*rows, *_full_adders(m, f"{step}_{k}", triple, width)]
    return list(rows)


def _full_adders(m: Module, name: str, rows: Sequence[Term], width: int) -> list[Term]:
    """The sums and the carries of three rows, bit by bit."""
    low = min(row.offset for row in rows)
    count = min(max(row.offset + len(row.value) for row in rows), width) - low
    x, y, z = (fitted(row.value.shift_left(row.offset - low), count, False) for row in rows)
    sums = Term(low, named(m, f"sums_{name}", x ^ y ^ z))
    # There are carries only where two rows have bits, and none leaves the width.
    first = sorted(row.offset for row in rows)[1] - low
    last = min(sorted(row.offset + len(row.value) for row in rows)[1] - low, width - low - 1)
    if last <= first:
        return [sums]
    carries = ((x & y) | (z & (x ^ y)))[first:last]
    return [sums, Term(low + first + 1, named(m, f"carries_{name}", Cat(carries)))]
