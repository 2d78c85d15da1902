"""Exact products of significands within an operator."""

from amaranth.hdl import Value

from kalmanhdl.arithmetic.product_structure import tree_levels
from kalmanhdl.rtl.adder_tree import summed
from kalmanhdl.rtl.floating.chain import Chain
from kalmanhdl.rtl.multiplier import block_products, logic_products
from kalmanhdl.rtl.shapes import fitted


def exact_product(
    chain: Chain, a: Value, b: Value, on_block: bool, state: dict[str, Value], *, then: bool
) -> dict[str, Value]:
    """``state`` with the ``product`` of two unsigned numbers, built of blocks or of logic.

    Its last level of adders is in the piece that is open afterwards. A product without adders is in the
    piece before, if something comes ``then`` that shall not wait for it in one piece.
    """
    width = len(a) + len(b)
    terms = (block_products if on_block else logic_products)(chain.module, "product", a, b)
    depth = tree_levels(len(terms))
    if depth:
        total, state = summed(chain.module, chain.stages, chain.piece + 1, terms, width, state)
        chain.skip(depth)
        return state | {"product": fitted(total, width, False)}
    state = state | {"product": fitted(terms[0].value.shift_left(terms[0].offset), width, False)}
    return chain.after_piece(state) if then else state
