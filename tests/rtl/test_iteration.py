"""Units that work for several clocks: the result is there when it is said to be, and is the defined one."""

from random import Random

import pytest
from amaranth.hdl import Shape
from streaming import repeated

from kalmanhdl.arithmetic.division_structure import ONE, Operand
from kalmanhdl.arithmetic.fixed import Fixed, Rounding
from kalmanhdl.rtl.divider import IterativeDivider
from kalmanhdl.rtl.serial_multiplier import SerialMultiplier
from kalmanhdl.rtl.square_root import IterativeSquareRoot


def check(core, operands, outputs):
    found, done = repeated(core, operands, outputs)
    expected = [core.compute(**given) for given in operands]
    assert found == [value if isinstance(value, tuple) else (value,) for value in expected]
    assert done == [core.latency * (k + 1) for k in range(len(operands))]


def operand(width: int, fraction: int, signed: bool) -> Operand:
    form = Fixed(width=width, fraction=fraction, signed=signed)
    return Operand(form=form, low=form.lowest, high=form.highest)


@pytest.mark.parametrize(("radix", "rows"), [(2, 1), (2, 3), (4, 1), (4, 2)])
@pytest.mark.parametrize("rounding", [Rounding.HALF_EVEN, Rounding.TOWARD_ZERO])
def test_an_iterative_divider_gives_the_defined_quotient(radix, rows, rounding):
    random = Random(f"{radix} {rows} {rounding}")
    dividend, divisor = operand(12, 3, True), operand(11, 5, False)
    form = Fixed(width=random.randrange(6, 14), fraction=random.randrange(-1, 9))
    core = IterativeDivider(dividend, divisor, form, rounding, radix, rows)
    sizes = [(random.randrange(12), random.randrange(12)) for _ in range(200)]
    operands = [
        {"dividend": random.randrange(-(1 << a), 1 << a), "divisor": random.randrange(1 << b)}
        for a, b in sizes
    ]
    check(core, operands, ("quotient", "outside"))


@pytest.mark.parametrize("radix", [2, 4])
def test_an_iterative_reciprocal_gives_the_defined_one(radix):
    core = IterativeDivider(ONE, operand(9, 4, False), Fixed(width=14, fraction=9), Rounding.HALF_UP, radix)
    found, _ = repeated(core, [{"divisor": b} for b in range(512)], ("quotient", "outside"))
    assert found == [core.compute(1, b) for b in range(512)]


@pytest.mark.parametrize(("width", "extra", "rows"), [(1, 0, 1), (9, 0, 1), (10, 3, 2), (7, 2, 3)])
def test_an_iterative_square_root_is_the_root_rounded_down(width, extra, rows):
    core = IterativeSquareRoot(width, extra, rows)
    check(core, [{"radicand": raw} for raw in range(1 << width)], ("root",))


@pytest.mark.parametrize("seed", range(4))
def test_a_serial_multiplier_gives_the_product(seed):
    random = Random(seed)
    a, b = (Shape(random.randrange(1, 20), random.random() < 0.6) for _ in "ab")
    core = SerialMultiplier(a, b, random.randrange(1, 4))

    def drawn(shape: Shape) -> int:
        low = -(1 << shape.width - 1) if shape.signed else 0
        high = low + (1 << shape.width) - 1
        return random.choice((low, high, random.randint(low, high)))

    check(core, [{"a": drawn(a), "b": drawn(b)} for _ in range(150)], ("product",))
