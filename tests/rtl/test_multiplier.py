"""A multiplier gives the exact product, from blocks or from logic, at any width and depth."""

import random

import pytest
from amaranth.hdl import Shape
from streaming import results

from kalmanhdl.arithmetic.product_structure import LogicProduct
from kalmanhdl.rtl.multiplier import Multiplier


def corners(shape: Shape) -> list[int]:
    if shape.signed:
        values = {0, 1, -1, -(1 << (shape.width - 1)), (1 << (shape.width - 1)) - 1}
        return sorted(v for v in values if -(1 << (shape.width - 1)) <= v < 1 << (shape.width - 1))
    return sorted({0, 1, (1 << shape.width) - 1, 1 << (shape.width - 1)})


def drawn(generator: random.Random, shape: Shape) -> int:
    value = generator.getrandbits(shape.width)
    return value - (1 << shape.width) if shape.signed and value >> (shape.width - 1) else value


@pytest.mark.parametrize("seed", range(12))
def test_products_are_exact(seed):
    generator = random.Random(seed)
    a, b = (Shape(generator.randrange(1, 41), generator.random() < 0.6) for _ in "ab")
    cores = [
        Multiplier(a, b, registers, on_block, logic)
        for registers in (0, *generator.sample(range(1, 9), 2))
        for on_block, logic in ((True, LogicProduct.BOOTH), *((False, kind) for kind in LogicProduct))
    ]
    stimuli = [{"a": x, "b": y} for x in corners(a) for y in corners(b)]
    stimuli += [{"a": drawn(generator, a), "b": drawn(generator, b)} for _ in range(60)]
    for core, values in zip(cores, results(cores, stimuli, ("product",)), strict=True):
        assert values == [(core.compute(**s),) for s in stimuli], (
            a,
            b,
            core.registers,
            core.on_block,
            core.logic,
        )
